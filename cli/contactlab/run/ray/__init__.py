"""An executor that runs the jobs of a sweep on a Ray cluster: `contactlab sweep --executor ray`."""
