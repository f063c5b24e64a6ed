"""Models without data that no motion depends on: nearly all bytes of most robots."""

from collections.abc import Iterable, Iterator, Mapping

import mujoco
import numpy as np
from numpy.typing import NDArray

Keep = NDArray[np.bool_]

_MESH_ROWS = {
    "nbvh": ("mesh_bvhadr", "mesh_bvhnum"),
    "noct": ("mesh_octadr", "mesh_octnum"),
    "nmeshvert": ("mesh_vertadr", "mesh_vertnum"),
    "nmeshnormal": ("mesh_normaladr", "mesh_normalnum"),
    "nmeshtexcoord": ("mesh_texcoordadr", "mesh_texcoordnum"),
    "nmeshface": ("mesh_faceadr", "mesh_facenum"),
    "nmeshpoly": ("mesh_polyadr", "mesh_polynum"),
}
"""Sizes of arrays with rows of meshes, and the fields with a mesh's first row and their number."""
_NESTED_ROWS = {
    "nmeshpolyvert": ("nmeshpoly", "mesh_polyvertadr", "mesh_polyvertnum"),
    "nmeshpolymap": ("nmeshvert", "mesh_polymapadr", "mesh_polymapnum"),
}
"""The same for rows of polygons and of vertices; these have rows of the size that comes first."""
_OTHER_ADDRESSES = {"body_bvhadr": "nbvh", "flex_bvhadr": "nbvh", "mesh_graphadr": "nmeshgraph"}
_HEAVY_FIELDS = {
    "bvh_aabb": "nbvhstatic",
    "mesh_vert": "nmeshvert",
    "mesh_face": "nmeshface",
    "tex_data": "ntexdata",
}
_LINE_BYTES = 64
_SHAPE_SENSORS = (
    "RANGEFINDER", "TACTILE", "GEOMDIST", "GEOMNORMAL", "GEOMFROMTO", "USER", "PLUGIN",
)  # fmt: skip


def drop_drawn_data(
    model: mujoco.MjModel, least_bytes: int = 1 << 18, *, keeps_rays: bool = True
) -> mujoco.MjModel:
    """Return a model without textures and without the meshes that only drawing reads.

    All objects keep their numbers, and it moves as the original does, bit for bit. The original
    itself is returned if less than `least_bytes` would go, or if its version of MuJoCo saves models
    in another form. If it need not keep rays, colliding meshes lose their faces, and the volumes
    around these: hulls collide by vertices and polygons.
    """
    keeps = dict(_list_kept_rows(model, keeps_rays=keeps_rays))
    going = [
        len(array) and array.nbytes * (1 - keeps[size].mean())
        for name, size in _HEAVY_FIELDS.items()
        for array in [np.asarray(getattr(model, name))]
        if size in keeps
    ]
    if sum(going) < least_bytes:
        return model
    try:
        name = "motion.mjb"
        return mujoco.MjModel.from_binary_path(name, {name: _write_rows(model, keeps)})
    except ValueError:
        return model


def _find_moving_meshes(model: mujoco.MjModel) -> Keep:
    # (nmesh,) whether a geom with a mesh may touch something, or may be measured.
    if _measures_shapes(model):
        return np.ones(model.nmesh, bool)
    solid = (np.asarray(model.geom_contype) | np.asarray(model.geom_conaffinity)) != 0
    solid[model.pair_geom1] = solid[model.pair_geom2] = True
    kinds = [int(mujoco.mjtGeom.mjGEOM_MESH), int(mujoco.mjtGeom.mjGEOM_SDF)]
    solid &= np.isin(model.geom_type, kinds)
    is_moving = np.zeros(model.nmesh, bool)
    is_moving[model.geom_dataid[solid]] = True
    return is_moving


def _measures_shapes(model: mujoco.MjModel) -> bool:
    sensors = {mujoco.mjtSensor(int(kind)).name for kind in model.sensor_type}
    reads_shapes = (word in name for name in sensors for word in _SHAPE_SENSORS)
    return bool(model.nplugin) or any(reads_shapes)


def _list_kept_rows(model: mujoco.MjModel, *, keeps_rays: bool) -> Iterator[tuple[str, Keep]]:
    # Sizes of arrays that lose rows, and (size,) whether a row stays.
    dropped_meshes, keeps = ~_find_moving_meshes(model), dict[str, Keep]()
    has_distances = bool((model.geom_type == mujoco.mjtGeom.mjGEOM_SDF).any())
    needs_faces = keeps_rays or has_distances or _measures_shapes(model)
    for size, (first, count) in _MESH_ROWS.items():
        if hasattr(model, size):
            is_hull = size in ("nmeshvert", "nmeshpoly")
            lost = dropped_meshes if is_hull or needs_faces else np.ones_like(dropped_meshes)
            begins, counts = getattr(model, first)[lost], getattr(model, count)[lost]
            keeps[size] = _keep_others(getattr(model, size), begins, counts)
    for size, (owner, first, count) in _NESTED_ROWS.items():
        if hasattr(model, size):
            lost = ~keeps[owner]
            begins, counts = getattr(model, first)[lost], getattr(model, count)[lost]
            keeps[size] = _keep_others(getattr(model, size), begins, counts)
    yield from keeps.items()
    # A hull has no number of rows: it ends where the next one begins.
    begins = np.asarray(model.mesh_graphadr)
    ends = np.append(np.sort(begins[begins >= 0]), model.nmeshgraph)
    own = begins[dropped_meshes & (begins >= 0)]
    counts = ends[np.searchsorted(ends, own, "right")] - own
    yield "nmeshgraph", _keep_others(model.nmeshgraph, own, counts)
    yield "nbvhstatic", keeps["nbvh"][: model.nbvhstatic]
    # MuJoCo refuses a texture without any data.
    yield "ntexdata", np.arange(model.ntexdata) == 0


def _keep_others(size: int, begins: NDArray[np.int32], counts: NDArray[np.int32]) -> Keep:
    steps = np.zeros(size + 1, int)
    some = (begins >= 0) & (counts > 0)
    np.add.at(steps, begins[some], 1)
    np.add.at(steps, begins[some] + counts[some], -1)
    return np.cumsum(steps)[:-1] == 0


def _write_rows(model: mujoco.MjModel, keeps: Mapping[str, Keep]) -> bytes:
    # A saved model is a header with all sizes, the options, and all arrays in the order of mjModel.
    from mujoco.introspect.structs import STRUCTS  # noqa: PLC0415 - for heavy models only

    saved_model = np.empty(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, saved_model)
    whole, addresses = saved_model.data, _list_addresses(model, keeps)
    chunks, sizes = list[bytes | memoryview](), dict[str, int]()
    widths = {"int": 4, "mjtSize": 8}  # bytes of a size
    extents = dict[str, str]()
    for field in STRUCTS["mjModel"].fields:
        name, extent = getattr(field, "name", ""), getattr(field, "array_extent", None)
        if extent:
            extents[name] = str(extent[0])
        elif width := widths.get(str(getattr(field, "type", ""))):
            sizes[name] = width
    lengths = {name: _count_bytes(getattr(model, name)) for name in extents}
    first = place = len(whole) - sum(lengths.values())
    for name, extent in extents.items():
        own, array = whole[place : place + lengths[name]], getattr(model, name)
        place += lengths[name]
        if own.tobytes() != (array if isinstance(array, bytes) else array.tobytes()):
            raise ValueError(f"{name} lies elsewhere")
        if name in addresses or extent in keeps:
            rows = np.asarray(addresses.get(name, array))
            own = (rows[keeps[extent]] if extent in keeps else rows).tobytes()
        chunks.append(own)
    buffer_sizes = [_count_buffer(each) for each in (lengths.values(), map(len, chunks))]
    if not 0 <= model.nbuffer - buffer_sizes[0] < _LINE_BYTES:
        raise ValueError("arrays begin elsewhere")
    changed = {size: int(keep.sum()) for size, keep in keeps.items()}
    changed["nbuffer"] = model.nbuffer + buffer_sizes[1] - buffer_sizes[0]
    own, other = (
        b"".join(
            int(number).to_bytes(width, "little", signed=True)
            for name, width in sizes.items()
            for number in [values[name] if name in values else getattr(model, name)]
        )
        for values in (dict[str, int](), changed)
    )
    head = whole[:first].tobytes()
    if own not in head:
        raise ValueError("sizes lie elsewhere")
    return b"".join([head.replace(own, other, 1), *chunks])


def _list_addresses(model: mujoco.MjModel, keeps: Mapping[str, Keep]) -> dict[str, np.ndarray]:
    # First rows and numbers of rows, after some rows have gone.
    fields = dict(_OTHER_ADDRESSES)
    counts = dict[str, tuple[str, str]]()
    for size, (first, count) in _MESH_ROWS.items():
        fields[first], counts[count] = size, (size, first)
    for size, (_, first, count) in _NESTED_ROWS.items():
        fields[first], counts[count] = size, (size, first)
    addresses = {"tex_adr": np.zeros_like(model.tex_adr)}
    for name in ("tex_height", "tex_width", "tex_nchannel"):  # all share the byte that is kept
        addresses[name] = np.ones_like(getattr(model, name))
    for name, size in fields.items():
        if size in keeps and hasattr(model, name):
            before = np.append(0, np.cumsum(keeps[size]))
            own = np.asarray(getattr(model, name))
            # Rows that are gone have no address.
            lost = ~np.append(keeps[size], True)[own]
            addresses[name] = np.where((own < 0) | lost, -1, before[own]).astype(own.dtype)
    for name, (size, first) in counts.items():
        if size in keeps:
            own = np.asarray(getattr(model, name))
            addresses[name] = np.where(addresses[first] < 0, 0, own).astype(own.dtype)
    return addresses


def _count_bytes(array: np.ndarray | bytes) -> int:
    return len(array) if isinstance(array, bytes) else array.nbytes


def _count_buffer(lengths: Iterable[int]) -> int:
    # In MuJoCo's buffer, each array begins at a cache line.
    total = 0
    for length in lengths:
        total += -total % _LINE_BYTES + length
    return total
