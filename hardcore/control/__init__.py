"""The operator's door and the feed: JSON lines over a Unix socket."""
