"""Made-up views for tests."""

from __future__ import annotations

import numpy as np
from goshawk_dashboards.state import views as view
from goshawk_proto import goshawk_pb2 as pb

IDENTITY_4 = np.array([1.0, 0.0, 0.0, 0.0])
REJECTIONS = {6: pb.REJECTION_COST, 7: pb.REJECTION_NONE, 8: pb.REJECTION_COST}


def make_plan(seq: int = 1, chosen: int | None = 7) -> view.PlanView:
    """15 candidates fanned out to the east of (10, 0, 2)."""
    azimuth = np.tile(np.linspace(0.7, -0.7, 5), 3)
    height = np.repeat([1.0, 0.0, -1.0], 5)
    end = np.stack([10 + 5 * np.cos(azimuth), 5 * np.sin(azimuth), 2 + height], axis=1)
    return view.PlanView(
        seq=seq,
        frame_ns=0,
        ready_ns=1,
        start_pos_world_3=np.array([10.0, 0.0, 2.0]),
        start_vel_world_3=np.array([1.0, 0.0, 0.0]),
        start_acc_world_3=np.zeros(3),
        world_from_cam_4=IDENTITY_4,
        duration_s=1.5,
        alpha=1.0,
        end_pos_world_N3=end,
        end_vel_world_N3=np.tile([2.0, 0.0, 0.0], (15, 1)),
        end_acc_world_N3=np.zeros((15, 3)),
        cost_N=np.linspace(1.0, 3.0, 15),
        added_NP=np.array([[0.3, 0.0, 0.12, 0.0] if k == 6 else [0.0] * 4 for k in range(15)]),
        objectness_N=np.ones(15),
        rejections=tuple(REJECTIONS.get(k, pb.REJECTION_OBJECTNESS) for k in range(15)),
        target_pos_world_N3=None,
        chosen=chosen,
    )
