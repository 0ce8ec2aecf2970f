"""Pages of results, for what is looked at in them."""

from collections.abc import Sequence

from tdfscal.files.calibration.document import Calibration
from tdfscal.findings import Finding
from tdfscal.reporting.calibration import calibration_report
from tdfscal.reporting.figures import drawings, residuals
from tdfscal.reporting.html import render
from tdfscal.reporting.validation import Origin, validation_report
from tdfscal.validation.residual_wrench import Validation


def render_page(c: Calibration) -> str:
    return render(calibration_report(c, drawings(c)))


def render_validation(v: Validation, findings: Sequence[Finding], origin: Origin) -> str:
    return render(validation_report(v, findings, origin, (residuals.validated(v),)))
