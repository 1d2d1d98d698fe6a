"""The log itself: its faults, the rows that may be used, and its rows on a uniform grid."""
