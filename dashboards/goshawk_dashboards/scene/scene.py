"""The 3-D view: what the vehicle sees, considers and flies, in the world frame (ENU, z up).

Every node is made once; a snapshot only moves, recolours or hides them. Stale things turn grey, then go.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import viser

from goshawk_dashboards.page import theme
from goshawk_dashboards.page.viewer import Viewer
from goshawk_dashboards.scene import curves, shapes
from goshawk_dashboards.scene.batch import Batch
from goshawk_dashboards.scene.goal import GoalScene
from goshawk_dashboards.scene.picture import decode_preview
from goshawk_dashboards.scene.remembered import FusedDepth, RememberedScene
from goshawk_dashboards.scene.target import TargetScene
from goshawk_dashboards.scene.tubes import Fan, Tube
from goshawk_dashboards.scene.world import GRID, NEAR_M, WorldScene
from goshawk_dashboards.state.airborne import Ground, Step
from goshawk_dashboards.state.snapshot import MAP_STALE_S, Snapshot
from goshawk_dashboards.state.views import Array, ControlView, PlanView

SAMPLES = 24
"""Points along a drawn trajectory."""
VEHICLE_DRAWN = 3.0
"""The vehicle is drawn this many times its size: 155 mm cannot be seen across a forest."""
CANDIDATE_RADIUS_M, FLOWN_RADIUS_M = 0.022, 0.055
"""Of the tubes that trajectories are drawn as: some pixels from where a camera follows."""
LEAST_OBJECTNESS = 0.1
"""A detection less sure than this is not drawn."""


@dataclass(frozen=True, kw_only=True)
class ViewOptions:
    """What the viewer asked to see."""

    rejected: bool = True
    world: bool = True
    trails: bool = True
    truth: bool = True
    frustum: bool = True
    detections: bool = True
    remembered: bool = True
    depth: bool = True


def prepare(server: viser.ViserServer) -> None:
    """Light and fog, once for a server."""
    scene = server.scene
    scene.set_up_direction("+z")
    scene.world_axes.visible = False
    scene.configure_fog(0.5 * NEAR_M, 1.1 * NEAR_M, color=theme.BACKGROUND)
    # Each light is worked out for each pixel, and one from a picture of the sky looked up there: too much without a
    # graphics card. A sun and the sky's own light are enough.
    scene.configure_default_lights(False)
    scene.configure_environment_map(None)
    scene.add_light_directional("/sun", intensity=2.0, position=(-0.4, -0.6, 1.0), cast_shadow=False)
    scene.add_light_hemisphere("/light", sky_color=(225, 232, 255), ground_color=(150, 146, 140), intensity=2.2)


class LiveScene:
    """Draws snapshots into a viewer's scene, in the light that ``prepare`` made."""

    def __init__(
        self,
        viewer: Viewer,
        root: str = "",
        vehicle_rgb: theme.Rgb = theme.VEHICLE,
        flown_rgb: theme.Rgb = theme.GOOD,
    ) -> None:
        """``root`` is the node that it is drawn under, so that several vehicles can share a scene."""
        self._viewer = viewer
        self._root = root
        self._vehicle_rgb, self._flown_rgb = theme.vivid(vehicle_rgb), theme.vivid(flown_rgb)
        self._plan_drawn: tuple[int, bool] | None = None
        self._preview_seq: int | None = None
        viewer.scene.add_grid(
            GRID,
            infinite_grid=True,
            cell_size=1.0,
            section_size=5.0,
            cell_color=theme.GRID,
            section_color=theme.GRID_SECTION,
            cell_thickness=0.6,
            fade_distance=90.0,
        )
        self.world = WorldScene(viewer, root)
        self.remembered = RememberedScene(viewer, root)
        self.depth = FusedDepth(viewer, f"{root}/depth")
        self._vehicle_trail = shapes.Trail(spacing_m=0.3)
        self._ground = Ground()
        self._make_vehicle()
        self._make_plan()
        self.target = TargetScene(viewer, root)
        self.goal = GoalScene(viewer, root)

    def _make_vehicle(self) -> None:
        scene = self._viewer.scene
        self.vehicle = scene.add_frame(f"{self._root}/vehicle", show_axes=False, visible=False)
        mesh = shapes.quadrotor(VEHICLE_DRAWN, self._vehicle_rgb)
        self.model = scene.add_mesh_trimesh(f"{self._root}/vehicle/model", mesh)
        self.ghost = scene.add_mesh_simple(
            f"{self._root}/vehicle/ghost",
            np.asarray(mesh.vertices),
            np.asarray(mesh.faces),
            color=theme.STALE,
            opacity=0.35,
            cast_shadow=False,
            visible=False,
        )
        self._label = scene.add_label(
            f"{self._root}/vehicle/label", "last seen here", position=(0.0, 0.0, 0.55), visible=False
        )
        self.disturbance = scene.add_arrows(
            f"{self._root}/disturbance",
            np.zeros((1, 2, 3)),
            theme.vivid(theme.DISTURBANCE),
            shaft_radius=0.025,
            head_radius=0.06,
            visible=False,
        )
        self.camera = scene.add_frame(f"{self._root}/camera", show_axes=False, visible=False)
        self.frustum = scene.add_camera_frustum(
            f"{self._root}/camera/frustum",
            fov=2.0 * np.arctan(48.0 / 80.0),
            aspect=160.0 / 96.0,
            scale=0.22,
            thickness=1.5,
            thickness_units="screen",
            color=self._vehicle_rgb,
            wxyz=shapes.CV_FROM_FLU_WXYZ,
            cast_shadow=False,
        )
        self._vehicle_line = Tube(
            self._viewer,
            f"{self._root}/trail/vehicle",
            self._vehicle_rgb,
            samples=shapes.TRAIL_POINTS,
            radius_m=shapes.TRAIL_RADIUS_M,
            tapering=True,
        )

    def _make_plan(self) -> None:
        viewer, root = self._viewer, f"{self._root}/plan"
        self.candidates = Fan(viewer, f"{root}/candidates", samples=SAMPLES, radius_m=CANDIDATE_RADIUS_M)
        self.detections = Batch(viewer, f"{root}/detections", shapes.mote(), theme.vivid(theme.TARGET))
        self.chosen = Tube(viewer, f"{root}/chosen", self._flown_rgb, samples=SAMPLES, radius_m=FLOWN_RADIUS_M)

    def update(self, snap: Snapshot, options: ViewOptions) -> None:
        """Shows one snapshot."""
        if snap.control is not None:
            self._draw_vehicle(snap.control, snap.fresh("control"), options)
        plan_fresh = snap.fresh("plan")
        self._draw_detections(snap.plan, plan_fresh and options.detections)
        self._draw_plan(snap.plan, plan_fresh, options)
        self._draw_camera(snap, options)
        remembered = snap.remembered if snap.fresh("map", MAP_STALE_S) else None
        self.remembered.update(remembered if options.remembered else None)
        target_3 = snap.target.pos_world_3 if snap.target is not None and snap.fresh("target") else None
        self.depth.update(remembered.depth if remembered is not None and options.depth else None, target_3)
        self.target.update(snap.target if snap.fresh("target") else None, trail=options.trails)
        truth = snap.truth if snap.fresh("sim_truth") else None
        self.target.show_truth(truth if options.truth else None)
        self.goal.update(truth)
        about_3 = None if snap.control is None else snap.control.pos_world_3
        moving = None if truth is None else truth.moving
        self.world.update(snap.world, moving, shown=options.world, about_3=about_3)

    def retrace(self, vehicle_N3: Array, target_N3: Array) -> None:
        """Where vehicle and target have been, oldest first, in place of what was seen here."""
        self._vehicle_trail.retrace(vehicle_N3)
        self._vehicle_line.draw(self._vehicle_trail.points_S3())
        self.target.retrace(target_N3)

    def forget(self) -> None:
        """Shows nothing of what was drawn: another vehicle is to be shown next."""
        self.clear_trails()
        self._ground = Ground()
        self._preview_seq = None
        self.frustum.image = None
        for node in (self.vehicle, self.camera, self.disturbance, self._vehicle_line.node):
            node.visible = False
        self.detections.hide()
        self.target.forget()
        self.goal.update(None)
        self.remembered.update(None)
        self.depth.update(None, None)
        self._hide_plan()

    def clear_trails(self) -> None:
        """Forgets where vehicle and target have been."""
        self._vehicle_trail.clear()
        self.target.clear_trail()

    def _draw_vehicle(self, control: ControlView, fresh: bool, options: ViewOptions) -> None:
        self.vehicle.visible = True
        self.vehicle.position = control.pos_world_3
        self.vehicle.wxyz = control.world_from_body_4
        self.model.visible = fresh
        self.ghost.visible = self._label.visible = not fresh
        push_3, step = control.acc_disturbance_world_3, Step.of(control)
        size = float(np.linalg.norm(push_3))
        self._ground.take(step)
        self.disturbance.visible = fresh and size > 0.2 and self._ground.airborne(step)
        if self.disturbance.visible:
            # 1 m/s2 is drawn 0.4 m long.
            tip_3 = 0.4 * push_3 * min(1.0, 5.0 / size)
            self.disturbance.position = control.pos_world_3
            self.disturbance.points = np.array([[np.zeros(3), tip_3]], dtype=np.float32)
        if self._vehicle_trail.add(control.pos_world_3):
            self._vehicle_line.draw(self._vehicle_trail.points_S3())
        self._vehicle_line.node.visible = options.trails and len(self._vehicle_trail) > 1

    def _draw_detections(self, plan: PlanView | None, shown: bool) -> None:
        """Where the candidates' cells see the target, the surer the larger, beside the filter's estimate."""
        if plan is None or not shown or plan.target_pos_world_N3 is None:
            self.detections.hide()
            return
        keep_N = plan.objectness_N > LEAST_OBJECTNESS
        size_N1 = np.clip(plan.objectness_N[keep_N], 0.0, 1.0)[:, None]
        self.detections.place(plan.target_pos_world_N3[keep_N], np.repeat(size_N1, 3, axis=1))

    def _draw_plan(self, plan: PlanView | None, fresh: bool, options: ViewOptions) -> None:
        if plan is None or not fresh or len(plan.cost_N) == 0:
            self._hide_plan()
            return
        if self._plan_drawn == (plan.seq, options.rejected):
            return
        self._plan_drawn = (plan.seq, options.rejected)
        # Drawn from the start state, and the node moved there: a viewer that is slow to take new curves still shows
        # the ones it has where the vehicle is.
        curves_NS3 = curves.plan_curves_NS3(plan, SAMPLES) - plan.start_pos_world_3
        shown_N = curves.choices_N(plan) | options.rejected
        with self._viewer.atomic():
            self.candidates.draw(plan.start_pos_world_3, curves_NS3, curves.colors_N3(plan), shown_N)
            self.chosen.node.position = plan.start_pos_world_3
            self.chosen.node.visible = plan.chosen is not None
            if plan.chosen is not None:
                self.chosen.draw(curves_NS3[plan.chosen])

    def _hide_plan(self) -> None:
        self.candidates.root.visible = self.chosen.node.visible = False
        self._plan_drawn = None

    def _draw_camera(self, snap: Snapshot, options: ViewOptions) -> None:
        self.camera.visible = options.frustum and snap.control is not None
        if snap.control is None:
            return
        self.camera.position = snap.control.pos_world_3
        if snap.plan is not None and snap.fresh("plan"):
            self.camera.wxyz = snap.plan.world_from_cam_4
        else:
            self.camera.wxyz = snap.control.world_from_body_4
        if snap.preview is not None and snap.preview.seq != self._preview_seq:
            self._preview_seq = snap.preview.seq
            picture = decode_preview(snap.preview)
            if picture is not None:
                self.frustum.aspect = picture.shape[1] / picture.shape[0]
                self.frustum.image = picture
