"""Off-screen rendering through EGL."""

import os
import sys
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from common.packages import graphics_hint
from services.sim.errors import RenderingUnavailableError
from services.sim.rendering.culling import Culling

Image = NDArray[np.uint8]
"""(height, width, 3) RGB, row 0 on top."""

_INSTALL = (
    "install libegl1 (Debian, Ubuntu: apt install libegl1 libgl1-mesa-dri; "
    "Fedora: dnf install mesa-libEGL mesa-dri-drivers). Everything but pictures runs without it."
)


_SHADOW_NEAR = 0.002
"""Near plane of pictures with shadows, in extents of the model. The light's depth map has the same
near plane; with a farther one its shadows speckle the floor."""
_SMALL_WIDTH, _SMALL_SHADOW = 640, 2048
"""A picture of at most this width shows no more than a depth map of this size holds; MuJoCo's usual
one of 4096 takes four times its 16 MB [pixels]."""
_PLAIN_SHAPES = (12, 2, 1)
"""Slices, stacks and quads of MuJoCo's shapes in plain pictures."""


def _remedy() -> str:
    """Return how to mend it: a variable that is set is suspected before a missing package."""
    if hint := graphics_hint("PYOPENGL_PLATFORM"):
        return hint
    if device := os.environ.get("MUJOCO_EGL_DEVICE_ID"):
        return f"MUJOCO_EGL_DEVICE_ID={device} chooses a device; unset it or choose another"
    return _INSTALL


class Offscreen:
    """Renders pictures of one size of one model.

    The context belongs to the thread that created it. MuJoCo's own renderer picks its GL library
    from an environment variable read at import; this one always uses EGL.
    """

    def __init__(
        self, model: Any, width: int, height: int, *, plain: bool = False, max_geoms: int = 2000
    ) -> None:
        """Open a context.

        Args:
            model: the ``mujoco.MjModel``; its settings of pictures are changed.
            width: [pixels].
            height: [pixels].
            plain: for speed, neither shadows nor reflections, and round shapes have few sides.
            max_geoms: largest number of geoms.

        Raises:
            RenderingUnavailableError: EGL is missing or cannot open a context.
        """
        self._context: Any = None
        try:
            # The import needs libEGL and opens the display, hence not at the top.
            from mujoco.egl import GLContext

            self._gl = GLContext(width, height)
            self._gl.make_current()
        except Exception as error:
            # PyOpenGL raises AttributeError, ImportError, RuntimeError or its own EGLError.
            raise RenderingUnavailableError(
                f"no off-screen OpenGL: {_remedy()} ({type(error).__name__}: {error})"
            ) from error
        self._model = model
        model.vis.global_.offwidth, model.vis.global_.offheight = width, height
        if plain:
            quality = model.vis.quality
            quality.numslices, quality.numstacks, quality.numquads = _PLAIN_SHAPES
            # Its memory is taken whether or not shadows are drawn.
            quality.shadowsize = 0
        else:
            if width <= _SMALL_WIDTH:
                model.vis.quality.shadowsize = min(model.vis.quality.shadowsize, _SMALL_SHADOW)
            model.vis.map.znear = min(model.vis.map.znear, _SHADOW_NEAR)
        # A shadow may be cast into the picture from outside it.
        self._culling = Culling(model, width / height) if plain else None
        self._rect = mujoco.MjrRect(0, 0, width, height)
        self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        if plain:
            _sample_once(self._context)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)
        self._scene = mujoco.MjvScene(model, max_geoms)
        self._option = mujoco.MjvOption()
        for flag in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION):
            self._scene.flags[flag] = not plain
        self._buffer = np.empty((height, width, 3), dtype=np.uint8)

    def render(self, data: Any, camera: Any) -> Image:
        """Return a new picture of ``data`` (after ``mj_kinematics``) through ``camera``."""
        if self._culling is not None:
            mujoco.mjv_updateCamera(self._model, data, camera, self._scene)
            self._culling.hide_unseen(data, self._scene)
        mujoco.mjv_updateScene(
            self._model,
            data,
            self._option,
            None,
            camera,
            mujoco.mjtCatBit.mjCAT_ALL.value,
            self._scene,
        )
        self._gl.make_current()
        mujoco.mjr_render(self._rect, self._scene, self._context)
        mujoco.mjr_readPixels(self._buffer, None, self._rect, self._context)
        return self._buffer[::-1].copy()

    def close(self) -> None:
        """Free the context; a second call does nothing."""
        if self._context is not None:
            # OpenGL names are valid in their own context only: freed while another renderer's is
            # current, they would delete that one's textures.
            self._gl.make_current()
            self._context.free()
            self._context = None
            self._gl.free()

    def __del__(self) -> None:
        if not sys.is_finalizing():  # by then the display itself is gone
            self.close()


def _sample_once(context: Any) -> None:
    """Read each pixel of a texture from one texel: with software OpenGL the rest is dear.

    The sky, a gradient, needs no mipmaps either.
    """
    from OpenGL import GL

    count = context.ntexture
    for name, kind in zip(context.texture[:count], context.textureType[:count], strict=True):
        sky = kind == mujoco.mjtTexture.mjTEXTURE_SKYBOX.value
        target = GL.GL_TEXTURE_CUBE_MAP if sky else GL.GL_TEXTURE_2D
        nearest = GL.GL_NEAREST if sky else GL.GL_NEAREST_MIPMAP_NEAREST
        GL.glBindTexture(target, int(name))
        GL.glTexParameteri(target, GL.GL_TEXTURE_MIN_FILTER, nearest)
        GL.glTexParameteri(target, GL.GL_TEXTURE_MAG_FILTER, GL.GL_NEAREST)


def fixed_camera(model: Any, name: str) -> Any:
    """Return a ``mujoco.MjvCamera`` for the model's camera ``name``."""
    camera = mujoco.MjvCamera()
    camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
    camera.fixedcamid = model.camera(name).id
    return camera
