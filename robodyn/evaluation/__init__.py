"""How a question is answered: by the formalism itself on float64 or 50-digit numbers, or by a kernel traced from it."""
