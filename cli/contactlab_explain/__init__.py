"""What contactlab's words and MuJoCo's contact settings mean: `contactlab explain`."""
