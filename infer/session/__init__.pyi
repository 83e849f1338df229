from .discover import find_videos as find_videos
from .probe import VideoInfo as VideoInfo
from .probe import is_video as is_video
from .probe import probe_video as probe_video
from .session import Session as Session
from .session import SessionOptions as SessionOptions
from .session import open_session as open_session
from .video import read_chunks as read_chunks

__all__ = [
    "Session",
    "SessionOptions",
    "VideoInfo",
    "find_videos",
    "is_video",
    "open_session",
    "probe_video",
    "read_chunks",
]
