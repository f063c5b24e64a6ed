"""Time that accuracy costs: fronts, orders, floors and a recommendation, from stored runs."""
