"""The judge: witnesses look at facts, the verdict weighs what they say. Pure."""
