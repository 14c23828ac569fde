"""From arrays of symbols to programs: what was computed, folded, ordered, and where each number lies."""
