"""Which controller flew: the nominal's replayed over a log, the ticks and commands of a log, those between its rows."""
