"""What is wrong with the log itself, what of it may be used, and the log on its grid."""
