"""What is done about it: the policy, the budget, the plan, the table, and the manager that drives it."""
