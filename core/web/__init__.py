"""HTTP in front of the book: requests become commands and questions, answers and refusals become responses."""
