"""Other supervisors in front of the same application, hit by the same blows, asked by the same client."""
