"""The report on a diagnosis: JSON, words, page, figures."""
