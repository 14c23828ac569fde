"""What is refused, by name: arguments (`inputs`) and motions that are not determined (`motion`)."""
