from .export import publish_solver as publish_solver
from .options import SolverTraining as SolverTraining

__all__ = [
    "SolverTraining",
    "publish_solver",
]
