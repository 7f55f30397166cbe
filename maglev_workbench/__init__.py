"""The `maglev` command: what an engineer types, and the pages and tables that answer."""
