"""Checks a draft certificate against the schema file that a user has."""

from __future__ import annotations

import warnings
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

from tdfscal.errors import UsageError

_XSD = "{http://www.w3.org/2001/XMLSchema}schema"


def schema_version(path: Path) -> str:
    """Return the version that a schema file states. Raises UsageError for no schema of a DCC 3."""
    version = _root(path).get("version", "")
    if not version.startswith("3."):
        raise UsageError(
            f"is a schema of version {version or 'none'}; a DCC of version 3 is written",
            where=str(path),
            hint="download dcc.xsd of version 3 from PTB",
        )
    return version


def check(document: str, path: Path) -> None:
    """Raise UsageError where a document does not obey the schema; no network is used.

    Schemas that it imports are looked for in its folder, by their target namespace.
    """
    try:
        import xmlschema
    except ImportError as error:
        raise UsageError(
            "checking a certificate needs the package xmlschema",
            where="--schema",
            hint="install tdfscal[dcc]",
        ) from error
    beside: dict[str, Any] = {
        space: str(other)
        for other in sorted(path.absolute().parent.glob("*.xsd"))
        if other.resolve() != path.resolve() and (space := _target(other))
    }
    try:
        with warnings.catch_warnings():
            # An import that is not found is an error where the schema uses it, and only there.
            warnings.simplefilter("ignore", xmlschema.XMLSchemaImportWarning)
            schema = xmlschema.XMLSchema(str(path), locations=beside, allow="local", loglevel=50)
    except (xmlschema.XMLSchemaException, ET.ParseError, OSError) as error:
        raise UsageError(
            f"the schema cannot be used: {_first_line(error)}",
            where=str(path),
            hint="put the schemas that it imports (SI_Format.xsd with its own imports, xmldsig) "
            "into its folder",
        ) from error
    fault = next(schema.iter_errors(document), None)
    if fault is not None:
        said = _first_line(fault.reason or fault)
        raise UsageError(
            f"the draft does not obey the schema at {fault.path}: {said}",
            where=str(path),
            hint="please report this with the version of the schema",
        )


def _root(path: Path) -> ET.Element:
    try:
        root = ET.parse(path).getroot()
    except (OSError, ET.ParseError) as error:
        raise UsageError(
            f"cannot be read as a schema: {_first_line(error)}",
            where=str(path),
            hint="give the file dcc.xsd",
        ) from error
    if root.tag != _XSD:
        raise UsageError("is no XML schema", where=str(path), hint="give the file dcc.xsd")
    return root


def _target(path: Path) -> str:
    try:
        return _root(path).get("targetNamespace", "")
    except UsageError:
        return ""


def _first_line(error: object) -> str:
    return str(error).strip().split("\n")[0].rstrip(".:")[:200]
