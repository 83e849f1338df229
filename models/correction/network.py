"""The correction network: the remaining error of a body fitted to markers, by messages on a graph of markers and
joints.

Nodes are the markers of SURFACE and the joints of BODY. Edges follow the skeleton and rigidity: from a marker to the
joint that carries it and to that joint's parent, from a joint to its parent and its children, between markers of the
same joint. Two layers reach two edges far, so that a distant limb cannot interfere. Every vector is expressed in the
axes of the joint that it belongs to: the network need not learn that a person may face any direction.

The locality follows X. Pan and others, "A Locality-Based Neural Solver for Optical Motion Capture", SIGGRAPH Asia 2023,
where the network replaces the fit; here it corrects a classical fit.
"""

from typing import Any

import torch
from torch import Tensor, nn

# Standard deviations of the Gaussian windows over which residuals are averaged, seconds; the whole take is added.
SPANS = (0.015, 0.06, 0.25)
# Per marker: in every window the mean residual and the number of frames; its position relative to the statistical
# body's, and that position. Per joint: see `features`.
MARKER_FEATURES = 4 * (len(SPANS) + 1) + 6
JOINT_FEATURES = 17
# Metres and radians per unit of output.
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
        """One round of messages.

        Args:
            m: markers (B, M, W).
            j: joints (B, J, W).
            carried: edge weights from marker to joint (B, J, M).
            same: between markers (B, M, M).
            up: from a joint to its child (J, J).
            down: from a joint to its parent (J, J).
        """
        gathered = carried @ self.to_joint(m) + up @ self.from_parent(j) + down @ self.from_child(j)
        j = j + self.joint(torch.cat([j, gathered], -1))
        back = carried.transpose(1, 2) @ self.to_marker(j) + same @ self.beside(m)
        return m + self.marker(torch.cat([m, back], -1)), j


class _PerNodeLinear(nn.Module):
    """A linear layer with separate weights for every node: a thigh's errors differ from a head's."""

    def __init__(self, nodes: int, inputs: int, outputs: int, scale: float = 1.0) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.randn(nodes, inputs, outputs) * scale / inputs**0.5)
        self.bias = nn.Parameter(torch.zeros(nodes, outputs))

    def forward(self, x: Tensor) -> Tensor:
        """(B, nodes, inputs) to (B, nodes, outputs)."""
        answer: Tensor = torch.einsum("bni,nio->bno", x, self.weight) + self.bias
        return answer


class _NeighbourhoodLinear(nn.Module):
    """For each joint a linear map of the features of the markers and joints next to it: the bulk of the correction.

    It is solved in closed form (`train.correction.ridge`) and not trained by gradient steps.
    """

    def __init__(self, carried: Tensor, touching: Tensor) -> None:
        super().__init__()
        self.markers: Tensor
        self.has_marker: Tensor
        self.joints: Tensor
        self.has_joint: Tensor
        for name, beside in (("marker", carried), ("joint", touching)):
            order, there = _neighbour_table(beside > 0)
            self.register_buffer(f"{name}s", order, persistent=False)
            self.register_buffer(f"has_{name}", there, persistent=False)
        inputs = self.markers.shape[1] * (MARKER_FEATURES + 1) + self.joints.shape[1] * JOINT_FEATURES
        self.weight = nn.Parameter(torch.zeros(len(carried), inputs, 6), requires_grad=False)
        self.bias = nn.Parameter(torch.zeros(len(carried), 6), requires_grad=False)

    def inputs(self, markers: Tensor, known: Tensor, joints: Tensor) -> Tensor:
        """(B, J, inputs): features of the markers and joints next to each joint, padded with zeros."""
        m = torch.cat([markers, known.unsqueeze(-1)], -1)[:, self.markers] * self.has_marker.unsqueeze(-1)
        j = joints[:, self.joints] * self.has_joint.unsqueeze(-1)
        return torch.cat([m.flatten(2), j.flatten(2)], -1)

    def forward(self, markers: Tensor, known: Tensor, joints: Tensor) -> Tensor:
        """(B, J, 6)."""
        answer: Tensor = torch.einsum("bji,jio->bjo", self.inputs(markers, known, joints), self.weight) + self.bias
        return answer


def _neighbour_table(beside: Tensor) -> tuple[Tensor, Tensor]:
    """(J, K) indices of the neighbours of each joint, and 1 where they exist; K is the largest number of neighbours."""
    most = int(beside.sum(1).max())
    order = torch.argsort(beside.int(), dim=1, descending=True, stable=True)[:, :most]
    return order, beside.gather(1, order).float()


class SolverNet(nn.Module):
    """Corrections of joints: a linear map of the neighbourhood, plus the result of message passing.

    Args:
        carrier: joint of each marker, M numbers.
        parents: of each joint, -1 for the root.
        width: of the features.
        layers: rounds of messages.
        dropout: share of the features that training drops.
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
        self.near = _NeighbourhoodLinear(self.carried, up + up.T + torch.eye(joints))
        self.marker_in = _PerNodeLinear(markers, MARKER_FEATURES, width)
        self.joint_in = _PerNodeLinear(joints, JOINT_FEATURES, width)
        self.layers = nn.ModuleList(_Layer(width) for _ in range(layers))
        self.norm = nn.LayerNorm(width)
        self.dropout = nn.Dropout(dropout)
        self.hidden = _PerNodeLinear(joints, width, width)
        self.out = _PerNodeLinear(joints, width, 6, scale=0.0)

    def forward(self, markers: Tensor, known: Tensor, joints: Tensor) -> Tensor:
        """Corrections (B, J, 6): rotation vector in units of ANGLE and translation in units of LENGTH, in each joint's
        axes.

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
        """(B, J) 1 where a joint or a neighbour carries a marker of the set; other joints stay as fitted."""
        return ((self.carried @ known.unsqueeze(-1)).squeeze(-1) > 0).to(known.dtype)
