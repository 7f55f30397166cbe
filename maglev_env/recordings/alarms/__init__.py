"""Alarms of a recording: lost levitation, stuck readings, missing or double samples, rails; a file for each rule."""
