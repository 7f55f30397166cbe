"""Files of recordings, as laboratories write them."""
