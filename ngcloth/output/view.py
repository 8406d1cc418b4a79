"""Pictures in space of a `Result` with PyVista: the cloth on its surface, thread by thread."""

import io
import os
import sys
from contextlib import contextmanager
from ctypes.util import find_library

import numpy as np
import pyvista as pv
from matplotlib import get_data_path

from .angles import BANDS, checked_limits, on_bands
from .files import checked_file, write_file
from .plot import (
    LABELS,
    central_frame,
    check_field,
    colours,
    default_pitch,
    plain,
    rims,
    sample,
    sampled_field,
    thread_levels,
    thread_positions,
)

MATT = {"smooth_shading": True, "ambient": 0.45, "diffuse": 0.55}
FONT_FILE = 4  # VTK's number of a font family read from a file
PICTURES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp")
BAR_SHARE = 0.2  # of the width of a picture, on the right


def cloth(
    result,
    *,
    field=None,
    pitch=None,
    screenshot=None,
    azimuth=-60.0,
    elevation=35.0,
    size=(900, 800),
    rings=100,
    limits=None,
):
    """Draw the cloth on its surface.

    Parameters
    ----------
    result : Result
        Solved or loaded.
    field : str, optional
        One of `ngcloth.plot.LABELS`, drawn in colours on the cloth. By default it is plain.
    pitch : float, optional
        Distance between the threads drawn, in units of length; by default about a twentieth of
        the width of the patch. Warp threads are the lines X2 = const, weft threads X1 = const.
    screenshot : path, optional
        Where to save the picture; the ending says how, PNG if there is none. Needs no display.
    azimuth, elevation : float, optional
        Where to look from, in degrees: `elevation` above the plane tangent to the surface at
        the centre of the domain, on the side of the cloth; `azimuth` about its normal, which
        points upwards in the picture, from the warp.
    size : (int, int), optional
        Width and height of the picture in pixels.
    rings : int, optional
        Fineness of the sampling, see `ngcloth.plot.sample`.
    limits : (float, float), optional
        Of the three colours of the field "angle", see `ngcloth.plot.draw`.

    Returns
    -------
    pyvista.Plotter
        Call ``show()`` on it for a window, or a picture in a notebook. It is closed if there is a
        `screenshot`.

    Raises
    ------
    InputError
        If there is no such field, no thread or too many at that pitch, or no such picture; if the
        limits are not two angles.
    OSError
        If the picture cannot be written, which leaves a former one as it was.
    RuntimeError
        If this machine has neither a display nor a library to draw without one.
    """
    if field is not None:
        check_field(field)
    checked_limits(limits, field)
    if screenshot is not None:
        screenshot = _checked_picture(screenshot)
    mesh = _sampled_surface(result, rings)
    off_screen = screenshot is not None or _no_display()
    with _window(off_screen):
        plotter = pv.Plotter(off_screen=off_screen, window_size=list(size))
    plotter.set_background("white")
    if field is None:
        plotter.add_mesh(mesh, color="gainsboro", **MATT)
    else:
        values = sampled_field(result, field, mesh.point_data["theta"])
        _add_map(plotter, mesh, field, values, limits)
    pitch = default_pitch(mesh.point_data["psi"]) if pitch is None else pitch
    for position, colour in thread_positions(result, mesh.point_data["psi"]):
        levels = thread_levels(position, pitch)
        lines = mesh.contour(list(levels), scalars=position).strip()
        tubes = lines.tube(radius=0.0016 * mesh.length, n_sides=8)
        plotter.add_mesh(tubes, color="dimgray" if field else colour, smooth_shading=True)
    for rim in rims(result.domain, 4 * rings):
        points = result.evaluate(result.whole.position, rim)
        edge = pv.lines_from_points(points, close=True)
        plotter.add_mesh(edge.tube(radius=0.0025 * mesh.length, n_sides=8), color="black")

    frame = central_frame(result)
    _look(plotter, mesh, frame, azimuth, elevation, BAR_SHARE if field else 0.0)
    if screenshot is not None:
        picture = _picture(plotter, screenshot.suffix.lower())
        plotter.close()
        write_file(screenshot, picture)
    return plotter


def _checked_picture(path):
    path = checked_file(path)
    return checked_file(path if path.suffix else path.with_suffix(".png"), *PICTURES)


def _picture(plotter, ending):
    from PIL import Image

    picture = io.BytesIO()
    Image.fromarray(plotter.screenshot(return_img=True)).save(
        picture, Image.registered_extensions()[ending]
    )
    return picture.getvalue()


def _no_display():
    return sys.platform == "linux" and not os.environ.get("DISPLAY")


@contextmanager
def _window(off_screen):
    """Have VTK make its window by EGL if there is no display: left alone it complains or crashes.

    VTK reads the environment as it makes a window; afterwards that is as it was.
    """
    name = "VTK_DEFAULT_OPENGL_WINDOW"
    if not (off_screen and _no_display()) or name in os.environ:
        yield
    elif find_library("EGL"):
        os.environ[name] = "vtkEGLRenderWindow"
        try:
            yield
        finally:
            del os.environ[name]
    elif find_library("OSMesa"):
        yield
    else:
        raise RuntimeError("no display, and neither libEGL nor libOSMesa to draw without one")


def _sampled_surface(result, rings):
    """The surface as triangles, with θ and ψ at each point."""
    theta, triangles = sample(result, rings)
    points = result.evaluate(result.whole.position, theta)
    mesh = pv.PolyData.from_regular_faces(points, triangles)
    mesh.point_data["theta"], mesh.point_data["psi"] = theta, result.psi(*theta.T)
    return mesh


def _add_map(plotter, mesh, field, values, limits):
    """The surface coloured by a field, and a colour bar that names it."""
    labels = None
    if field == "angle":
        limits = checked_limits(limits)
        values, greatest = on_bands(values, limits)
        ends, colour_map = [0, 3], list(BANDS)
        labels = {k: f"{angle:.3g}" for k, angle in enumerate((0, *limits, greatest))}
    else:
        chosen = colours(field, values)
        ends, colour_map = [chosen["vmin"], chosen["vmax"]], chosen["cmap"]
    mesh.point_data[field] = values
    actor = plotter.add_mesh(
        mesh,
        scalars=field,
        cmap=colour_map,
        clim=ends,
        annotations=labels,
        show_scalar_bar=False,
        **MATT,
    )
    height = plotter.window_size[1]
    bar = plotter.add_scalar_bar(
        title=plain(LABELS[field]) + "\n",
        mapper=actor.mapper,
        vertical=True,
        position_x=1 - BAR_SHARE,
        position_y=0.1,
        width=0.08,
        height=0.8,
        color="black",
        title_font_size=height // 32,
        label_font_size=height // 36,
        fmt="%.2f" if np.ptp(ends) > 0.1 else "%.5f",
        n_labels=0 if labels else 5,
    )
    if labels:  # beside the bar like numbers, not between it and the cloth
        bar.SetTextPositionToPrecedeScalarBar()
    # The fonts that VTK brings along have no Greek letters.
    for text in (bar.GetTitleTextProperty(), bar.GetLabelTextProperty()):
        text.SetFontFamily(FONT_FILE)
        text.SetFontFile(f"{get_data_path()}/fonts/ttf/DejaVuSans.ttf")


def _look(plotter, mesh, frame, azimuth, elevation, bar_share):
    """Place the camera, without perspective, so that the surface fills the picture."""
    warp, weft, normal = frame
    a, e = np.radians([azimuth, elevation])
    level = np.cos(a) * warp + np.sin(a) * weft
    direction = np.cos(e) * level + np.sin(e) * normal
    up = np.cos(e) * normal - np.sin(e) * level
    right = np.cross(up, direction)

    across, along = mesh.points @ right, mesh.points @ up
    width, height = plotter.window_size
    scale = 0.53 * max(np.ptp(along), np.ptp(across) * height / width / (1 - bar_share))
    focus = (across.min() + across.max()) / 2 * right + (along.min() + along.max()) / 2 * up
    focus += bar_share * scale * width / height * right
    plotter.camera_position = [focus + 3 * mesh.length * direction, focus, up]
    plotter.enable_parallel_projection()
    plotter.camera.parallel_scale = scale
    plotter.renderer.reset_camera_clipping_range()
