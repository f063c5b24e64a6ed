"""What two models do not have alike, in numbers and in motion: `contactlab diff A B`."""
