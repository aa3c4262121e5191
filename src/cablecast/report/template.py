"""The environment in which the pages of reports are rendered."""

from typing import TYPE_CHECKING

from cablecast.errors import MissingExtraError

if TYPE_CHECKING:
    import jinja2


def template_environment() -> "jinja2.Environment":
    """Return the templates of this package; all text is escaped, and a missing name is an error.

    Raises:
        MissingExtraError: jinja2 is not installed.
    """
    try:
        import jinja2
    except ImportError:
        raise MissingExtraError("jinja2", "report", "writing the report") from None
    return jinja2.Environment(
        loader=jinja2.PackageLoader("cablecast", "report"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
