"""What a user brings: policies, scenarios, public suites; and the three published systems."""
