"""What is said about it: JSON, words, page, figures."""
