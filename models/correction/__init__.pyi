from .features import SolverInput as SolverInput
from .features import apply_corrections as apply_corrections
from .features import solver_input as solver_input
from .network import SolverNet as SolverNet

__all__ = [
    "SolverInput",
    "SolverNet",
    "apply_corrections",
    "solver_input",
]
