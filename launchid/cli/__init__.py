"""The command line: parser and options, messages and progress, exit statuses."""
