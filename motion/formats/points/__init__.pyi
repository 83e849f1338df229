from .c3d import Analog as Analog
from .c3d import C3DTake as C3DTake
from .c3d import Event as Event
from .c3d import read_c3d as read_c3d
from .c3d import read_c3d_take as read_c3d_take
from .c3d import write_c3d as write_c3d
from .csv import read_csv as read_csv
from .csv import write_csv as write_csv
from .marker_protocol import find_marker_set as find_marker_set
from .marker_protocol import read_marker_set as read_marker_set
from .marker_protocol import write_marker_set as write_marker_set
from .npz import read_npz as read_npz
from .npz import write_npz as write_npz
from .parquet import read_parquet as read_parquet
from .parquet import write_parquet as write_parquet
from .trc import read_trc as read_trc
from .trc import write_trc as write_trc
from .unlabelled import MarkerCloud as MarkerCloud
from .unlabelled import read_marker_cloud as read_marker_cloud

__all__ = [
    "Analog",
    "C3DTake",
    "Event",
    "MarkerCloud",
    "find_marker_set",
    "read_c3d",
    "read_c3d_take",
    "read_csv",
    "read_marker_cloud",
    "read_marker_set",
    "read_npz",
    "read_parquet",
    "read_trc",
    "write_c3d",
    "write_csv",
    "write_marker_set",
    "write_npz",
    "write_parquet",
    "write_trc",
]
