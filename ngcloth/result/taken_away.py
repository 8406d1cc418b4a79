"""What a result hands to a person: points of the patch, pictures, patterns, fields and files."""

from ..output.cut import export_dxf, export_svg


class TakenAway:
    """The methods of a `Result` that hand on to other modules: places, drawings, files."""

    export_svg = export_svg
    export_dxf = export_dxf

    def flatten(self, points):
        """Where points of the surface go on the flat patch.

        Parameters
        ----------
        points : array_like, (..., 3)
            Points on or near the surface, in its coordinates.

        Returns
        -------
        ndarray, (..., 2)
            The flat positions of the nearest points of the surface.

        Raises
        ------
        InputError
            If a point is farther from the surface than that is large, as in another unit.
        """
        from .places import flatten

        return flatten(self, points)

    def lay(self, flat):
        """Where points of the flat patch go on the surface.

        Parameters
        ----------
        flat : array_like, (..., 2)
            Flat positions, in units of length.

        Returns
        -------
        ndarray, (..., 3)
            Points of the surface; NaN outside the patch.
        """
        from .places import lay

        return lay(self, flat)

    def plot(self, field=None, where="patch", ax=None, limits=None):
        """Draw the threads, over a field if one is named, with matplotlib.

        ``where="domain"`` draws them on the parameter domain and ``"history"`` how the solve went;
        the field "angle" has three colours, with `limits` of 15° and 30° by default; see
        `ngcloth.plot.draw`.
        """
        from ..output.plot import draw

        return draw(self, field, where, ax, limits)

    def view(self, field=None, *, pitch=None, screenshot=None, limits=None):
        """Draw the cloth on its surface with PyVista, to be turned by ``result.view().show()``.

        `screenshot` names a picture to write instead; see `ngcloth.view.cloth`.
        """
        from ..output.view import cloth

        return cloth(self, field=field, pitch=pitch, screenshot=screenshot, limits=limits)

    def area_beyond(self, limits=None):
        """Area under cloth that is sheared by more than each limit, 15° and 30° by default.

        A dict of (area on the surface, its share) by limit.
        """
        from ..output.angles import area_beyond

        return area_beyond(self, limits)

    def certificate(self):
        """Check this result from its ψ alone, see `ngcloth.verify`.

        Returns
        -------
        Certificate
        """
        from .certificate import verify

        return verify(self)

    def save(self, folder):
        """Write everything to a folder of open formats, for `ngcloth.load` to read.

        Parameters
        ----------
        folder : path
            Made with its parents. An empty folder, or one that holds nothing but a saved result,
            is replaced; at any moment the old result or the new one is there, whole.

        Raises
        ------
        InputError
            If `folder` is something else, or cannot be written.
        """
        from .save import save

        save(self, folder)

    def export_vtu(self, path):
        """Write the cloth with its fields for ParaView, see `ngcloth.fields.vtu`."""
        from ..output.fields import vtu

        return vtu(self, path)

    def export_threads(self, path, pitch=None):
        """Write the threads `pitch` apart as polylines (.vtp), see `ngcloth.fields.threads`."""
        from ..output.fields import threads

        return threads(self, path, pitch)

    def export_surface(self, path, tolerance=None):
        """Write surface and patch as triangles (.stl, .obj), see `ngcloth.fields.surface`."""
        from ..output.fields import surface

        return surface(self, path, tolerance)

    def export_fibres(self, path, format=None, *, thickness=None, order=None):
        """Write thread directions as a table (.csv), or as shells for a structural solver.

        `format` is "csv", "abaqus", "calculix", "nastran" or "lsdyna", by default what the ending
        says; `thickness` that of the flat cloth; see `ngcloth.fields.fibres`.
        """
        from ..output.fibres import fibres

        return fibres(self, path, format, thickness=thickness, order=order)
