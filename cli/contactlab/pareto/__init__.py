"""Cost of accuracy in time: fronts, orders, floors and a recommendation, from stored runs."""
