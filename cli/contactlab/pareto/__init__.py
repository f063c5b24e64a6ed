"""What accuracy costs in time: fronts, orders, floors and a recommendation, from stored runs."""
