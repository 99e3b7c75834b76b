"""Identifies the parameters of non-linear machines by the Trajectory Pattern Method.

    model = tpm.Model.from_file("cart.tpm")
    result = tpm.identify(model, t, {"x": x, "u": u})
    result.save("result.json")
"""

from tpm import _example
from tpm._campaign import Campaign, Submission
from tpm._model import (
    Imported,
    Model,
    Proposal,
    compare,
    identify,
    import_robot,
    inertias,
    inspect,
    inspect_log,
    payload,
    propose,
    propose_log,
    validate,
    validate_log,
)
from tpm._result import Identification, Picture, Validation
from tpm._tpm import Entry, Error, Run, Table, __version__

__all__ = [
    "Campaign",
    "Entry",
    "Error",
    "Identification",
    "Imported",
    "Model",
    "Picture",
    "Proposal",
    "Run",
    "Submission",
    "Table",
    "Validation",
    "__version__",
    "compare",
    "identify",
    "import_robot",
    "inertias",
    "inspect",
    "inspect_log",
    "payload",
    "propose",
    "propose_log",
    "validate",
    "validate_log",
]
