"""Oracles on disk: a folder with `manifest.json` and `weights.safetensors`."""

from __future__ import annotations

import hashlib
import json
import shutil
import tempfile
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pirlc.diagnostics import PirlcError
from pirlc.oracle.manifest import FORMAT, Manifest, from_json, to_json
from pirlc.oracle.network import ACTIVATIONS, Network, NetworkOracle, Scaling, head_width
from pirlc.oracle.problems import (
    DamagedOracle,
    ForeignFile,
    NewerFormat,
    UnreadableOracle,
    Unwritable,
    failure,
)
from pirlc.resources import user_cache

MANIFEST, WEIGHTS = "manifest.json", "weights.safetensors"


@dataclass(frozen=True)
class StoredOracle:
    """An oracle of pirlc's own format with its manifest and its folder."""

    oracle: NetworkOracle
    manifest: Manifest
    folder: Path


def weight_bytes(network: Network) -> bytes:
    """The network's numbers as a safetensors file; the same network gives the same bytes."""
    from safetensors.numpy import save

    tensors = {"offset": network.scaling.offset, "scale": network.scaling.scale}
    for i, (weight, bias) in enumerate(zip(network.weights, network.biases, strict=True)):
        tensors[f"weight.{i}"] = weight
        tensors[f"bias.{i}"] = bias
    return save({name: np.ascontiguousarray(tensor) for name, tensor in tensors.items()})


def default_cache() -> Path:
    """The folder of trained oracles in the user's cache."""
    return user_cache() / "oracles"


def check_place(folder: Path) -> None:
    """Find out before a long training whether an oracle can be saved there.

    Raises PirlcError E0615.
    """
    try:
        _refuse_foreign(folder)
        folder.parent.mkdir(parents=True, exist_ok=True)
        Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.parent)).rmdir()
    except OSError as error:
        raise failure(Unwritable(str(folder), error.strerror or str(error))) from error


def _refuse_foreign(folder: Path) -> None:
    if folder.exists() and not (folder / MANIFEST).is_file() and any(folder.iterdir()):
        raise failure(Unwritable(str(folder), "it exists and does not hold an oracle"))


def save_oracle(oracle: NetworkOracle, manifest: Manifest, folder: Path) -> StoredOracle:
    """Write the folder whole or not at all; an oracle that is there already is replaced.

    The manifest is saved with the hash of the weights. Raises PirlcError E0615.
    """
    data = weight_bytes(oracle.network)
    manifest = replace(manifest, sha256=hashlib.sha256(data).hexdigest())
    draft: Path | None = None
    try:
        _refuse_foreign(folder)
        folder.parent.mkdir(parents=True, exist_ok=True)
        draft = Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.parent))
        draft.chmod(0o755)
        (draft / WEIGHTS).write_bytes(data)
        text = json.dumps(to_json(manifest), indent=2, allow_nan=False) + "\n"
        (draft / MANIFEST).write_text(text, encoding="utf-8")
        if folder.exists():
            # A folder cannot be renamed onto one with files in it.
            shutil.rmtree(folder)
        draft.replace(folder)
    except OSError as error:
        raise failure(Unwritable(str(folder), error.strerror or str(error))) from error
    finally:
        if draft is not None:
            with suppress(OSError):
                shutil.rmtree(draft)
    return StoredOracle(oracle, manifest, folder)


def load_stored(folder: Path) -> StoredOracle:
    """Read an oracle of pirlc's own format. Raises PirlcError E0601 to E0604."""
    name = str(folder)
    if not (folder / MANIFEST).is_file():
        if not folder.exists():
            raise failure(UnreadableOracle(name, "there is no such file or folder"))
        raise failure(ForeignFile(name, f"it is a folder without {MANIFEST}"))
    try:
        text = (folder / MANIFEST).read_bytes()
        data = (folder / WEIGHTS).read_bytes()
    except OSError as error:
        raise failure(UnreadableOracle(name, f"{error.strerror or error}")) from error
    try:
        content = json.loads(text)
    except ValueError as error:
        raise failure(DamagedOracle(name, f"{MANIFEST} is not JSON: {error}")) from error
    found = content.get("format") if isinstance(content, dict) else None
    if not isinstance(found, int):
        raise failure(ForeignFile(name, f"{MANIFEST} does not describe an oracle"))
    if found > FORMAT:
        raise failure(NewerFormat(name, found, FORMAT))
    try:
        manifest = from_json(content)
        if hashlib.sha256(data).hexdigest() != manifest.sha256:
            raise ValueError(f"{WEIGHTS} is not the file that the manifest was written for")
        return StoredOracle(
            NetworkOracle(_network(data, manifest), manifest.head), manifest, folder
        )
    except ValueError as error:
        raise failure(DamagedOracle(name, str(error))) from error


def _network(data: bytes, manifest: Manifest) -> Network:
    """A ValueError says what does not fit the manifest."""
    from safetensors import SafetensorError
    from safetensors.numpy import load

    if manifest.activation not in ACTIVATIONS:
        raise ValueError(f"unknown activation {manifest.activation!r}")
    layers = manifest.layers
    try:
        tensors = load(data)
    except SafetensorError as error:
        raise ValueError(f"{WEIGHTS} cannot be read: {error}") from error

    def tensor(key: str, shape: tuple[int, ...]) -> NDArray[np.float32]:
        found = tensors.get(key)
        if found is None or found.shape != shape or found.dtype != np.float32:
            raise ValueError(f"{WEIGHTS} lacks `{key}` of shape {shape} in binary32")
        if not np.isfinite(found).all():
            raise ValueError(f"`{key}` in {WEIGHTS} holds numbers that are not finite")
        return found

    scaling = Scaling(tensor("offset", layers[:1]), tensor("scale", layers[:1]))
    count = len(layers) - 1
    if count < 1 or layers[-1] != head_width(manifest.head):
        raise ValueError("the layers do not fit the actions")
    weights = tuple(tensor(f"weight.{i}", (layers[i + 1], layers[i])) for i in range(count))
    biases = tuple(tensor(f"bias.{i}", (layers[i + 1],)) for i in range(count))
    return Network(scaling, weights, biases, manifest.activation)


def list_stored(folder: Path) -> tuple[StoredOracle, ...]:
    """The oracles in a folder of oracles, by name; what cannot be read is passed over."""
    found = []
    if folder.is_dir():
        for entry in sorted(folder.iterdir()):
            if (entry / MANIFEST).is_file() and not entry.name.startswith("."):
                with suppress(PirlcError):
                    found.append(load_stored(entry))
    return tuple(found)
