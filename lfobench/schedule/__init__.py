"""What is left of a plan, arranged for the machine and carried out; shows nothing itself."""
