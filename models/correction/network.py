"""The solver's network: what a body fitted to markers is still off, by messages on a graph of markers and joints.

Nodes are the markers of SURFACE and the joints of BODY. Edges run only where skeleton or rigidity has them: a marker
to the joint that carries it and to that joint's parent, a joint to its parent and its children, a marker to the markers
of the same joint. Two layers see two hops, so that a far limb cannot disturb. Every vector is given and returned in the
axes of the joint that it belongs to: the network need not learn that a person may face any way.

Source of the idea of locality: X. Pan and others, "A Locality-Based Neural Solver for Optical Motion Capture",
SIGGRAPH Asia 2023; there the network solves by itself, here it corrects a classical fit.
"""

from typing import Any

import torch
from torch import Tensor, nn

# Standard deviations of the Gaussian windows that residuals are averaged in, seconds; the whole take is one more.
SPANS = (0.015, 0.06, 0.25)
# Of a marker: in every window its mean residual and how many frames took part; its place beyond the statistical body's
# and where it sits. Of a joint: see `geometry.solver_features`.
MARKER_FEATURES = 4 * (len(SPANS) + 1) + 6
JOINT_FEATURES = 17
# Metres and radians of one unit.
LENGTH, ANGLE = 0.01, 0.1


class _Layer(nn.Module):
    """Messages from markers and joints to joints, and back."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.to_joint = nn.Linear(width, width, bias=False)
        self.from_parent, self.from_child = nn.Linear(width, width, bias=False), nn.Linear(width, width, bias=False)
        self.to_marker = nn.Linear(width, width, bias=False)
        self.beside = nn.Linear(width, width, bias=False)
        self.joint = nn.Sequential(nn.LayerNorm(2 * width), nn.Linear(2 * width, width), nn.ReLU(),
                                   nn.Linear(width, width))  # fmt: skip
        self.marker = nn.Sequential(nn.LayerNorm(2 * width), nn.Linear(2 * width, width), nn.ReLU(),
                                    nn.Linear(width, width))  # fmt: skip

    def forward(self, m: Tensor, j: Tensor, carried: Tensor, same: Tensor, up: Tensor, down: Tensor
                ) -> tuple[Tensor, Tensor]:  # fmt: skip
        """Markers (B, M, W), joints (B, J, W); weights of the edges: marker to joint (B, J, M), marker to marker
        (B, M, M), joint to its child (J, J) and to its parent (J, J)."""
        gathered = carried @ self.to_joint(m) + up @ self.from_parent(j) + down @ self.from_child(j)
        j = j + self.joint(torch.cat([j, gathered], -1))
        back = carried.transpose(1, 2) @ self.to_marker(j) + same @ self.beside(m)
        return m + self.marker(torch.cat([m, back], -1)), j


class _Own(nn.Module):
    """A linear layer that every node has of its own: what a thigh is off is not what a head is."""

    def __init__(self, nodes: int, inputs: int, outputs: int, scale: float = 1.0) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.randn(nodes, inputs, outputs) * scale / inputs**0.5)
        self.bias = nn.Parameter(torch.zeros(nodes, outputs))

    def forward(self, x: Tensor) -> Tensor:
        """(B, nodes, inputs) to (B, nodes, outputs)."""
        answer: Tensor = torch.einsum("bni,nio->bno", x, self.weight) + self.bias
        return answer


class _Near(nn.Module):
    """Of each joint a linear map of what markers and joints beside it have: the bulk of the answer.

    It is solved in closed form (`train.solver_linear`) and not trained by steps.
    """

    def __init__(self, carried: Tensor, touching: Tensor) -> None:
        super().__init__()
        self.markers: Tensor
        self.has_marker: Tensor
        self.joints: Tensor
        self.has_joint: Tensor
        for name, beside in (("marker", carried), ("joint", touching)):
            order, there = _padded(beside > 0)
            self.register_buffer(f"{name}s", order, persistent=False)
            self.register_buffer(f"has_{name}", there, persistent=False)
        inputs = self.markers.shape[1] * (MARKER_FEATURES + 1) + self.joints.shape[1] * JOINT_FEATURES
        self.weight = nn.Parameter(torch.zeros(len(carried), inputs, 6), requires_grad=False)
        self.bias = nn.Parameter(torch.zeros(len(carried), 6), requires_grad=False)

    def inputs(self, markers: Tensor, known: Tensor, joints: Tensor) -> Tensor:
        """(B, J, inputs): features of the markers and joints beside each joint, zeros where there are fewer."""
        m = torch.cat([markers, known.unsqueeze(-1)], -1)[:, self.markers] * self.has_marker.unsqueeze(-1)
        j = joints[:, self.joints] * self.has_joint.unsqueeze(-1)
        return torch.cat([m.flatten(2), j.flatten(2)], -1)

    def forward(self, markers: Tensor, known: Tensor, joints: Tensor) -> Tensor:
        """(B, J, 6)."""
        answer: Tensor = torch.einsum("bji,jio->bjo", self.inputs(markers, known, joints), self.weight) + self.bias
        return answer


def _padded(beside: Tensor) -> tuple[Tensor, Tensor]:
    """(J, K) which are beside each joint, and 1 where they are; K is the most that any has."""
    most = int(beside.sum(1).max())
    order = torch.argsort(beside.int(), dim=1, descending=True, stable=True)[:, :most]
    return order, beside.gather(1, order).float()


class SolverNet(nn.Module):
    """Corrections of joints: of each a linear map of what is beside it, and what messages add to that.

    Args:
        carrier: joint of each marker, M numbers; parents: of each joint, -1 for the root.
        width: of the features; layers: rounds of messages; dropout: share of the features that training leaves out.
    """

    def __init__(
        self, carrier: list[int], parents: list[int], width: int = 64, layers: int = 2, dropout: float = 0.1
    ) -> None:
        super().__init__()
        self.config: dict[str, Any] = {"carrier": carrier, "parents": parents, "width": width, "layers": layers,
                                       "dropout": dropout}  # fmt: skip
        markers, joints = len(carrier), len(parents)
        self.carried: Tensor
        self.same: Tensor
        self.up: Tensor
        self.down: Tensor
        own = torch.zeros(joints, markers)
        own[torch.tensor(carrier), torch.arange(markers)] = 1.0
        up = torch.zeros(joints, joints)
        for j, parent in enumerate(parents):
            if parent >= 0:
                up[j, parent] = 1.0
        self.register_buffer("carried", own + 0.5 * (up.T @ own) + 0.5 * (up @ own), persistent=False)
        same = own.T @ own
        self.register_buffer("same", same - torch.eye(markers), persistent=False)
        self.register_buffer("up", up, persistent=False)
        self.register_buffer("down", up.T / up.T.sum(1, keepdim=True).clamp(min=1), persistent=False)
        self.near = _Near(self.carried, up + up.T + torch.eye(joints))
        self.marker_in = _Own(markers, MARKER_FEATURES, width)
        self.joint_in = _Own(joints, JOINT_FEATURES, width)
        self.layers = nn.ModuleList(_Layer(width) for _ in range(layers))
        self.norm = nn.LayerNorm(width)
        self.dropout = nn.Dropout(dropout)
        self.hidden = _Own(joints, width, width)
        self.out = _Own(joints, width, 6, scale=0.0)

    def forward(self, markers: Tensor, known: Tensor, joints: Tensor) -> Tensor:
        """Corrections (B, J, 6): rotation vector in units of ANGLE and shift in units of LENGTH, in each joint's axes.

        Args:
            markers: (B, M, MARKER_FEATURES).
            known: (B, M) 1 for markers of the set, else 0.
            joints: (B, J, JOINT_FEATURES).
        """
        m, j = self.dropout(torch.relu(self.marker_in(markers))), self.dropout(torch.relu(self.joint_in(joints)))
        there = known.unsqueeze(1)
        carried = self.carried * there
        carried = carried / carried.sum(-1, keepdim=True).clamp(min=1.0)
        same = self.same * there
        same = same / same.sum(-1, keepdim=True).clamp(min=1.0)
        for layer in self.layers:
            m, j = layer(m, j, carried, same, self.up, self.down)
        hidden = torch.relu(self.hidden(self.dropout(self.norm(j))))
        answer: Tensor = self.out(self.dropout(hidden)) + self.near(markers, known, joints)
        return answer * self.reached(known).unsqueeze(-1)

    def reached(self, known: Tensor) -> Tensor:
        """(B, J) 1 where a joint or one beside it carries a marker of the set; others stay as they were fitted."""
        return ((self.carried @ known.unsqueeze(-1)).squeeze(-1) > 0).to(known.dtype)
