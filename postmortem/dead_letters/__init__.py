"""Dead letters: requests that were set aside, from the slip the guard leaves to their end."""
