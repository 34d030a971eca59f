"""Scenes of holes photographed by MuJoCo's renderer (OpenGL): its own geometry, light and hard shadows.

The plate is a mesh with real pockets and finger holes, its markers are textures, things are MuJoCo's primitives, and
the lamp casts shadows by a shadow map. MuJoCo draws a larger ideal pinhole image, which is then drawn through the lens.
Its pixels count from their corners, ours from their centres (docs/sources.md, "Corners in images").

OpenGL comes from the machine: EGL with Mesa's software driver will do (Debian: libegl1 libegl-mesa0 libgl1-mesa-dri).
"""

from __future__ import annotations

from functools import cache
from typing import Any

import cv2
import mujoco
import numpy as np

from arm.board import PLATE_CENTRE, PLATE_SIZE, POCKET_FLOOR, POCKET_MOUTH, Board
from arm.robot.shapes import Body, Box, Capsule
from arm.se3 import Array
from pictures.boards import TABLE
from pictures.holes import POCKET_DEPTH, HoleScene, exposed
from render.light import FINGER_HOLE, KIND_GREY, MARKER_BLACK, MARKER_WHITE
from render.rays import Floats, pixel_rays
from vision.camera.model import Camera, Image
from vision.markers.dictionaries import marker_modules

BORDER_PX = 60  # of the pinhole image, for what the lens draws in
SEGMENTS = 32  # of a finger hole's rim
FINGER_RADIUS = 0.008
TEXELS = 32  # of a marker's module
MARKER_HEIGHT = 1e-4  # of the print over the plate, so that it hides the plate


@cache
def _egl() -> Any:
    """MuJoCo's class of EGL contexts, whatever MUJOCO_GL says, or why there is none."""
    try:
        from mujoco.egl import GLContext

        GLContext(16, 16).free()
    except Exception as error:  # noqa: BLE001  (PyOpenGL raises what it likes where libraries are missing)
        return f"{type(error).__name__}: {error}"
    return GLContext


def why_no_opengl() -> str:
    """Why MuJoCo cannot render here; empty if it can."""
    found = _egl()
    return found if isinstance(found, str) else ""


def _rendered(model: mujoco.MjModel, width: int, height: int) -> Floats:
    """The image of the camera 0, (height, width) grey levels; rows from the top."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    context = _egl()(width, height)
    try:
        context.make_current()
        resources = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, resources)
        view = mujoco.MjvCamera()
        view.type, view.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, 0
        drawn = mujoco.MjvScene(model, maxgeom=200)
        mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, view, mujoco.mjtCatBit.mjCAT_ALL, drawn)
        pixels = np.zeros((height, width, 3), dtype=np.uint8)
        area = mujoco.MjrRect(0, 0, width, height)
        mujoco.mjr_render(area, drawn, resources)
        mujoco.mjr_readPixels(pixels, None, area, resources)
        resources.free()
    finally:
        context.free()
    return pixels[::-1, :, 0].astype(np.float32)


def mujoco_photographs(scene: HoleScene, camera: Camera, count: int = 2) -> list[Image]:
    """MuJoCo's photographs of a scene, of one moment."""
    spec = mujoco.MjSpec()
    spec.stat.center, spec.stat.extent = scene.T_base_board[:3, 3], 0.5
    width, height = camera.size[0] + 2 * BORDER_PX, camera.size[1] + 2 * BORDER_PX
    _add_light(spec, scene)
    _add_camera(spec, camera, width, height)
    _add_plate(spec, scene.board, scene.T_base_board)
    _add_body(spec, TABLE, KIND_GREY["table"])
    for body, grey in scene.things:
        _add_body(spec, body, grey)
    model = spec.compile()
    model.vis.quality.shadowsize, model.vis.quality.offsamples = 8192, 4
    model.vis.global_.offwidth, model.vis.global_.offheight = width, height
    model.vis.map.znear, model.vis.map.zfar = 0.1, 10.0
    model.vis.map.shadowclip = 1.5
    model.vis.headlight.diffuse[:] = model.vis.headlight.specular[:] = 0.0
    model.vis.headlight.ambient[:] = scene.light.ambient
    pinhole = _rendered(model, width, height)
    return exposed(_through_lens(pinhole, camera), scene, camera, count)


def _through_lens(pinhole: Floats, camera: Camera) -> Floats:
    rays = pixel_rays(camera)
    (fx, skew, cx), (_, fy, cy) = camera.K[0], camera.K[1]
    x = (fx * rays.x + skew * rays.y + cx + BORDER_PX).astype(np.float32)
    y = (fy * rays.y + cy + BORDER_PX).astype(np.float32)
    return np.asarray(cv2.remap(pinhole, x, y, cv2.INTER_CUBIC), dtype=np.float32)


def _add_light(spec: mujoco.MjSpec, scene: HoleScene) -> None:
    lamp = np.array(scene.light.lamp)
    direct = 1.0 - scene.light.ambient
    towards = scene.T_base_board[:3, 3] - lamp
    spec.worldbody.add_light(
        pos=lamp,
        dir=towards / np.linalg.norm(towards),
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        castshadow=True,
        ambient=[0.0] * 3,
        diffuse=[direct] * 3,
        specular=[0.1] * 3,
    )


def _add_camera(spec: mujoco.MjSpec, camera: Camera, width: int, height: int) -> None:
    R = camera.T_base_camera[:3, :3] @ np.diag([1.0, -1.0, -1.0])  # OpenGL's camera looks along -z, y up
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, R.ravel())
    cx, cy = camera.K[0, 2] + BORDER_PX + 0.5, camera.K[1, 2] + BORDER_PX + 0.5
    spec.worldbody.add_camera(
        name="camera",
        pos=camera.T_base_camera[:3, 3],
        quat=quat,
        resolution=[width, height],
        sensor_size=[width * 1e-5, height * 1e-5],
        focal_pixel=[camera.K[0, 0], camera.K[1, 1]],
        principal_pixel=[width / 2 - cx, height / 2 - cy],
    )


def _placed(T: Array) -> dict[str, Array]:
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, np.ascontiguousarray(T[:3, :3]).ravel())
    return {"pos": T[:3, 3], "quat": quat}


def _add_body(spec: mujoco.MjSpec, body: Body, grey: float) -> None:
    rgba = [grey / 255.0] * 3 + [1.0]
    match body.shape:
        case Box(size):
            spec.worldbody.add_geom(
                type=mujoco.mjtGeom.mjGEOM_BOX,
                size=np.array(size) / 2,
                rgba=rgba,
                **_placed(body.T_base_body),
            )
        case Capsule(radius, length):
            spec.worldbody.add_geom(
                type=mujoco.mjtGeom.mjGEOM_CAPSULE,
                size=[radius, length / 2, 0.0],
                rgba=rgba,
                **_placed(body.T_base_body),
            )
        case other:
            raise TypeError(f"{type(other).__name__} is not drawn here")


def _add_plate(spec: mujoco.MjSpec, board: Board, T_base_board: Array) -> None:
    plate, holes = _plate_quads(board)
    for name, quads, grey in (("plate", plate, KIND_GREY["board"]), ("finger holes", holes, FINGER_HOLE)):
        vertices, count = np.concatenate(quads), 4 * np.arange(len(quads))[:, None]  # own corners: flat faces
        faces = np.concatenate([count + [0, 1, 2], count + [0, 2, 3]])
        mesh = spec.add_mesh(name=name, uservert=vertices.ravel(), userface=faces.ravel())
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
        body = spec.worldbody.add_body(**_placed(T_base_board))
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=name,
            rgba=[grey / 255.0] * 3 + [1.0],
            contype=0,
            conaffinity=0,
        )
    for number, (marker_id, outline) in enumerate(zip(board.marker_ids, board.marker_corners(), strict=True)):
        modules = np.pad(marker_modules("DICT_4X4_50", marker_id), 1, constant_values=True)
        texels = np.kron(np.where(modules, MARKER_WHITE, MARKER_BLACK), np.ones((TEXELS, TEXELS))).astype(
            np.uint8
        )
        spec.add_texture(
            name=f"marker {number}",
            type=mujoco.mjtTexture.mjTEXTURE_2D,
            width=texels.shape[1],
            height=texels.shape[0],
            nchannel=3,
            data=np.repeat(texels[..., None], 3, axis=-1).ravel(),
        )
        textures = [""] * mujoco.mjtTextureRole.mjNTEXROLE
        textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = f"marker {number}"
        spec.add_material(name=f"marker {number}", textures=textures, specular=0.0)
        half = board.marker_size * (0.5 + 1.0 / 6.0)
        body = spec.worldbody.add_body(**_placed(T_base_board))
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_PLANE,
            size=[half, half, 1.0],
            pos=outline.mean(axis=0) + (0.0, 0.0, MARKER_HEIGHT),
            material=f"marker {number}",
        )


def _plate_quads(board: Board) -> tuple[list[Array], list[Array]]:
    """Corners (4, 3) of the plate's faces, counter-clockwise from outside, and of the finger holes'."""
    (lx, ly, thick), (cx, cy) = PLATE_SIZE, PLATE_CENTRE
    low, high = np.array([cx - lx / 2, cy - ly / 2]), np.array([cx + lx / 2, cy + ly / 2])
    m, f = POCKET_MOUTH / 2, POCKET_FLOOR / 2
    cuts = [
        sorted({low[i], high[i], *(h[i] + s * m for h in board.holes for s in (-1, 1))}) for i in range(2)
    ]
    plate, holes = [], []
    for x0, x1 in zip(cuts[0], cuts[0][1:], strict=False):
        for y0, y1 in zip(cuts[1], cuts[1][1:], strict=False):
            middle = np.array([(x0 + x1) / 2, (y0 + y1) / 2])
            if not (np.abs(board.holes[:, :2] - middle).max(axis=1) < m).any():
                plate.append(np.array([[x0, y0, 0], [x1, y0, 0], [x1, y1, 0], [x0, y1, 0]], dtype=float))
    corners = [(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])]
    for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
        plate.append(np.array([[*a, -thick], [*b, -thick], [*b, 0.0], [*a, 0.0]]))
    angle = 2 * np.pi * np.arange(SEGMENTS) / SEGMENTS
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    square = f * ring / np.abs(ring).max(axis=1, keepdims=True)
    for hole in board.holes:
        s = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        for k in range(4):
            a, b = s[k], s[(k + 1) % 4]
            wall = [[*(m * a), 0.0], [*(m * b), 0.0], [*(f * b), -POCKET_DEPTH], [*(f * a), -POCKET_DEPTH]]
            plate.append(np.array(wall)[::-1] + hole)
        for k in range(SEGMENTS):
            n = (k + 1) % SEGMENTS
            floor = [[*square[k], -POCKET_DEPTH], [*square[n], -POCKET_DEPTH]]
            floor += [
                [*(FINGER_RADIUS * ring[n]), -POCKET_DEPTH],
                [*(FINGER_RADIUS * ring[k]), -POCKET_DEPTH],
            ]
            plate.append(np.array(floor) + hole)
            inner = [[*(FINGER_RADIUS * ring[n]), z] for z in (-POCKET_DEPTH, -thick)]
            inner += [[*(FINGER_RADIUS * ring[k]), z] for z in (-thick, -POCKET_DEPTH)]
            holes.append(np.array(inner)[::-1] + hole)
            bottom = [
                [0, 0],
                FINGER_RADIUS * ring[k],
                FINGER_RADIUS * (ring[k] + ring[n]) / 2,
                FINGER_RADIUS * ring[n],
            ]
            holes.append(np.array([[*p, -thick + 1e-4] for p in bottom]) + hole)
    return plate, holes
