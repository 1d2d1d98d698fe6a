"""The terminal: options, messages, exit statuses."""
