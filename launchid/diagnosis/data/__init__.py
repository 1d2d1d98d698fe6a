"""The log itself: what is wrong with it, what of it may be used, and its rows on a uniform grid."""
