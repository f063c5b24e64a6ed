"""Make the runs of this folder on Newton as Isaac Lab sets it: python check_isaaclab.py.

UNTRIED: written for Isaac Lab 3.0, of which only the documentation was at hand. It takes the solver
that `isaaclab_newton.physics.MJWarpSolverCfg` describes by default, whose integrator, cone and
tolerances take the place of the model's. No task and no USD is involved. It lies beside
`check_newton.py`, and needs what that needs.
"""

import argparse
import inspect

import newton
from check_newton import check
from isaaclab_newton.physics import MJWarpSolverCfg

# Memory is as this folder says, so that nothing is dropped.
OWN = {"nconmax", "njmax"}


def settings() -> dict[str, object]:
    """Return what Isaac Lab gives to the solver by default."""
    known = inspect.signature(newton.solvers.SolverMuJoCo).parameters
    given = MJWarpSolverCfg().to_dict()
    return {name: given[name] for name in given if name in known and name not in OWN}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--device", default="cuda:0", help="what Newton computes on")
    check("isaaclab", parser.parse_args().device, **settings())
