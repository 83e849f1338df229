"""The labelling network: assigns labels to markers by message passing between geometric neighbours.

A point is a node; its edges go only to its nearest neighbours, so that distant points (a second person, ghost markers)
cannot interfere. There is no attention, and no layer in which all points meet; only the final assignment (Sinkhorn) is
global over the frame. Points come with a short time window: where they were and will be, as far as their trajectory is
known.
"""

from typing import Any

import torch
from torch import Tensor, nn

from muybridge.models.labelling.message_passing import gather_messages

# Times of the window relative to the frame, seconds.
WINDOW = (-0.3, -0.1, 0.1, 0.3)
NEIGHBOURS = 8
FAR = 1e4
# Unit of length in the features, metres.
LENGTH = 0.3


class _Layer(nn.Module):
    """One round of messages: maximum and mean over the neighbours, then a network per node."""

    def __init__(self, width: int, message: int, edge: int) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(width)
        self.here, self.there = nn.Linear(width, message), nn.Linear(width, message, bias=False)
        self.edge = nn.Linear(edge, message, bias=False)
        self.mix = nn.Sequential(nn.Linear(width + 2 * message, width), nn.ReLU(), nn.Linear(width, width))

    def forward(self, h: Tensor, edge: Tensor, neighbour: Tensor) -> Tensor:
        x = self.norm(h)
        gathered = gather_messages(self.here(x), self.there(x), self.edge(edge), neighbour)
        gathered = torch.cat([x, gathered.to(x.dtype)], -1)
        mixed: Tensor = h + self.mix(gathered)
        return mixed


class LabelNet(nn.Module):
    """Points of a frame to the logarithm of their assignment to labels.

    Args:
        labels: number of labels.
        width: of the nodes' features.
        message: width of the messages.
        edge: width of the edges' features.
        layers: rounds of messages.
        neighbours: edges of a node.
        rounds: of Sinkhorn normalisation.
    """

    def __init__(self, labels: int = 72, width: int = 64, message: int = 40, edge: int = 24, layers: int = 5,
                 neighbours: int = NEIGHBOURS, rounds: int = 4) -> None:  # fmt: skip
        super().__init__()
        self.config: dict[str, Any] = {"labels": labels, "width": width, "message": message, "edge": edge,
                                       "layers": layers, "neighbours": neighbours, "rounds": rounds}  # fmt: skip
        self.labels, self.neighbours, self.rounds = labels, neighbours, rounds
        window = len(WINDOW)
        self.edges = nn.Sequential(nn.Linear(11 + 4 * window, edge), nn.ReLU(), nn.Linear(edge, edge), nn.ReLU())
        self.nodes = nn.Linear(4 * window, width)
        self.set = nn.Linear(labels, width)
        self.layers = nn.ModuleList(_Layer(width, message, edge) for _ in range(layers))
        self.out = nn.Sequential(nn.LayerNorm(width), nn.Linear(width, labels + 1))
        self.dust = nn.Parameter(torch.zeros(()))

    def forward(self, points: Tensor, seen: Tensor, asked: Tensor) -> Tensor:
        """Assignment of a batch of frames.

        Args:
            points: (B, 1 + W, N, 3) metres, z up; the frame itself, then the times of `WINDOW`.
            seen: (B, 1 + W, N) 1 where a point is known, else 0.
            asked: (B, L) 1 for labels of the marker set.

        Returns:
            (B, N, L + 1) logarithm of the assignment, the last column the dustbin.
        """
        return self.assign(self.logits(points, seen, asked), seen, asked)

    def assign(self, scores: Tensor, seen: Tensor, asked: Tensor) -> Tensor:
        """Sinkhorn normalisation of `logits`; shapes as in `forward`."""
        return sinkhorn(scores, seen[:, 0], asked, self.dust, self.rounds)

    def logits(self, points: Tensor, seen: Tensor, asked: Tensor) -> Tensor:
        """(B, N, L + 1) before the assignment; arguments as in `forward`."""
        b, _, n, _ = points.shape
        at, known, k = points[:, 0] / LENGTH, seen[:, 0], self.neighbours
        neighbour = self._neighbours(at, known)

        def there(x: Tensor) -> Tensor:
            return x.reshape(b * n, -1).index_select(0, neighbour).reshape(b * n, k, -1)

        to = there(at) - at.reshape(b * n, 1, 3)
        heading = self._heading(to)
        moved = (points[:, 1:] - points[:, :1]).permute(0, 2, 1, 3).reshape(b * n, -1, 3) / LENGTH
        linked = seen[:, 1:].permute(0, 2, 1).reshape(b * n, -1, 1)
        features = torch.cat([moved * linked, linked], -1).flatten(1)  # (B N, 4 W)
        both = features.reshape(b * n, 1, -1, 4), there(features).reshape(b * n, k, -1, 4)
        linked = both[0][..., 3:] * both[1][..., 3:]
        relative = _turn((both[1][..., :3] - both[0][..., :3]) * linked, heading.reshape(b * n, 1, 1, 2))
        distance = (to.square().sum(-1, keepdim=True) + 1e-8).sqrt()
        other = there(heading)
        edge = torch.cat([
            _turn(to, heading.unsqueeze(1)), _turn(to, other), _turn(other, heading.unsqueeze(1)), distance,
            torch.exp(-distance), torch.exp(-4 * distance), torch.cat([relative, linked], -1).flatten(2),
        ], -1)  # fmt: skip
        edge = self.edges(edge)
        own = torch.cat([_turn(both[0][:, 0, :, :3], heading.unsqueeze(1)), both[0][:, 0, :, 3:]], -1).flatten(1)
        h = (self.nodes(own).reshape(b, n, -1) + self.set(asked).unsqueeze(1)).reshape(b * n, -1)
        for layer in self.layers:
            h = layer(h, edge, neighbour)
        out: Tensor = self.out(h).reshape(b, n, -1)
        return out

    @staticmethod
    def _heading(to: Tensor) -> Tensor:
        """(R, 2) horizontal unit vectors of nodes: towards the mean of their neighbours.

        All vectors at a node are expressed relative to its heading, so that the network does not have to learn that a
        person may face any direction.
        """
        towards = to[..., :2].mean(1)
        towards = towards + torch.tensor([1e-4, 0.0], device=to.device)
        return towards / towards.square().sum(-1, keepdim=True).sqrt()

    def _neighbours(self, at: Tensor, known: Tensor) -> Tensor:
        """Flat indices (B * N * K) of the nearest known points; the point itself where there are fewer."""
        b, n, _ = at.shape
        gap = (at.unsqueeze(2) - at.unsqueeze(1)).square().sum(-1)
        # A point is not its own neighbour, and an unknown one is nobody's.
        hidden = (1 - known).unsqueeze(1) + torch.eye(n, device=at.device).unsqueeze(0)
        nearest, index = (gap + hidden * FAR).topk(self.neighbours, dim=2, largest=False)
        itself = torch.arange(n, device=at.device).reshape(1, n, 1)
        index = torch.where(nearest < FAR / 2, index, itself)
        return (index + (torch.arange(b, device=at.device) * n).reshape(b, 1, 1)).reshape(-1)


def _turn(vectors: Tensor, heading: Tensor) -> Tensor:
    """Vectors (..., 2 or 3) relative to horizontal headings (..., 2): the first axis along the heading, z unchanged."""
    c, s = heading[..., :1], heading[..., 1:]
    x, y = vectors[..., :1], vectors[..., 1:2]
    return torch.cat([x * c + y * s, y * c - x * s, vectors[..., 2:]], -1)


def sinkhorn(scores: Tensor, known: Tensor, asked: Tensor, dust: Tensor, rounds: int) -> Tensor:
    """Scores to the logarithm of an assignment in which every known point goes to one label or to the dustbin, and
    every requested label gets one point or none (Sarlin et al. 2020).

    Args:
        scores: (B, N, L + 1); the last column is the dustbin's.
        known: (B, N), 1 or 0.
        asked: (B, L), 1 or 0.
        dust: score of a label that gets no point.
        rounds: of normalisation.
    """
    b, n, columns = scores.shape
    none = dust.reshape(1, 1, 1).expand(b, 1, columns)
    z = torch.cat([scores, none], 1)  # (B, N + 1, L + 1)
    z = torch.cat([z[:, :, :-1] + (asked.unsqueeze(1) - 1) * FAR, z[:, :, -1:]], 2)
    rows = torch.cat([known, asked.sum(1, keepdim=True)], 1)  # masses
    cols = torch.cat([asked, known.sum(1, keepdim=True)], 1)
    log_rows, log_cols = torch.log(rows + 1e-9), torch.log(cols + 1e-9)
    u, v = torch.zeros_like(log_rows), torch.zeros_like(log_cols)
    for _ in range(rounds):
        v = log_cols - torch.logsumexp(z + u.unsqueeze(2), 1)
        u = log_rows - torch.logsumexp(z + v.unsqueeze(1), 2)
    return (z + u.unsqueeze(2) + v.unsqueeze(1))[:, :-1]
