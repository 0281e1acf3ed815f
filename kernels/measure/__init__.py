"""What is found out about worlds: their health, volumes, masses and the rows of a batch's table."""
