"""Preparation of a URDF for Pinocchio (continuous joints, mesh files), and disabled collisions from its SRDF.

Mesh names follow ROS: ``package://PACKAGE/path`` (or ``model://``), ``file:///path``, or a path relative to the URDF.
Packages are searched in the caller's folders, in the folders above the URDF, and in those of ROS: ROS_PACKAGE_PATH
(ROS 1) and AMENT_PREFIX_PATH (ROS 2, ``<prefix>/share/PACKAGE``).
"""

from __future__ import annotations

import difflib
import os
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from itertools import combinations, product
from pathlib import Path
from urllib.parse import unquote

import numpy as np

from arm.arguments import shown
from arm.errors import FileInputError, InputError
from arm.io.storage import read_text

Pairs = frozenset[frozenset[str]]

SAME_NAME = " (joint)"

_TURNS = 2.0 * np.pi  # rad, range of a continuous joint in each direction
_SEVERAL = 5  # pairs of an SRDF, of which one at least is of links of its URDF
_ALIKE = 0.8  # of a misspelt name and the one that is meant; 0.89 of 'uper' and 'upper'
_SCHEMES = ("package://", "model://")
# and the folder of packages in each entry
_ROS_PATHS = {"ROS_PACKAGE_PATH": "", "AMENT_PREFIX_PATH": "share"}


def read_urdf(urdf: Path, package_dirs: Iterable[str | Path], text: str | None = None) -> tuple[str, str]:
    """Return the text of the file (or `text` instead), and the same prepared for Pinocchio.

    The prepared text has a range of one revolution in each direction for continuous joints, so that Pinocchio
    represents them by one number instead of a cosine and sine; absolute paths of collision meshes; and `SAME_NAME`
    after the name of a joint that is also that of a link, because Pinocchio cannot tell these apart.

    Raises:
        FileInputError: not XML, a xacro file, or a mesh is missing.
    """
    text = read_text(urdf) if text is None else text
    root = _parsed(urdf, text)
    changed = _bounded(root) | _renamed(root)
    folders = _folders(package_dirs)
    for link in root.findall("link"):
        for mesh in link.findall("collision/geometry/mesh"):
            mesh.set("filename", str(_mesh(urdf, link.get("name", ""), mesh.get("filename", ""), folders)))
            changed = True
    return text, ElementTree.tostring(root, encoding="unicode") if changed else text


def _folders(package_dirs: Iterable[str | Path]) -> list[Path]:
    listed = isinstance(package_dirs, Iterable) and not isinstance(package_dirs, str | bytes | Path)
    folders = list(package_dirs) if listed else []
    wrong = [folder for folder in folders if not isinstance(folder, str | Path)]
    if wrong or not listed:
        value = shown(wrong[0] if wrong else package_dirs)
        why = f"package_dirs: {value}: must be a list of folders, each a string or a Path"
        raise InputError(why, value=value)
    return [Path(folder) for folder in folders]


def _parsed(urdf: Path, text: str) -> ElementTree.Element:
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        if "<xacro:" in text:
            raise _is_xacro(urdf) from error
        raise FileInputError(urdf, "", None, f"is not a URDF: {error}") from error
    for element in root.iter():
        if "xacro" in element.tag or any("${" in value or "$(" in value for value in element.attrib.values()):
            raise _is_xacro(urdf)
    return root


def _is_xacro(urdf: Path) -> FileInputError:
    made = urdf.name.removesuffix(".xacro")
    made = made if made.endswith(".urdf") and made != urdf.name else f"{urdf.stem}_plain.urdf"
    help = f"`xacro {urdf.name} > {made}` (pip install xacro, or ROS) makes the URDF; give that file"
    return FileInputError(urdf, "", None, "is xacro, not a URDF", help)


def _bounded(root: ElementTree.Element) -> bool:
    endless = [joint for joint in root.findall("joint") if joint.get("type") == "continuous"]
    for joint in endless:
        joint.set("type", "revolute")
        limit = joint.find("limit")
        if limit is None:
            limit = ElementTree.SubElement(joint, "limit", {"effort": "0", "velocity": "0"})
        limit.set("lower", str(-_TURNS))
        limit.set("upper", str(_TURNS))
    return bool(endless)


def _renamed(root: ElementTree.Element) -> bool:
    links = {link.get("name") for link in root.findall("link")}
    same = [joint for joint in root.findall("joint") if joint.get("name") in links]
    for joint in same:
        joint.set("name", f"{joint.get('name')}{SAME_NAME}")
    return bool(same)


def _mesh(urdf: Path, link: str, name: str, package_dirs: Sequence[Path]) -> Path:
    """Return the path of a mesh."""
    here = urdf.resolve().parent
    scheme = next((scheme for scheme in _SCHEMES if name.startswith(scheme)), None)
    if scheme is None:
        path = Path(unquote(name.removeprefix("file://")) if name.startswith("file://") else name)
        places: Iterator[Path] = (folder / path for folder in (here, *here.parents[:2], *package_dirs))
        help = "paths are relative to the URDF's folder"
    else:
        package, _, rest = name.removeprefix(scheme).partition("/")
        folders = [*package_dirs, *_ros_folders(), here, *here.parents]
        places = (folder / rest for folder in _package_folders(package, folders))
        help = (
            f"give package_dirs=[...] with the folder that contains {package}, or set ROS_PACKAGE_PATH (ROS 1) or "
            "AMENT_PREFIX_PATH (ROS 2)"
        )
    found = next((place for place in places if place.is_file()), None)
    if found is None:
        raise FileInputError(urdf, f"link {link}: mesh", name, "could not be found", help)
    return found.resolve()


def _package_folders(package: str, folders: Iterable[Path]) -> Iterator[Path]:
    """Yield candidates for a package: below each folder, below its share, or the folder itself."""
    for folder in folders:
        yield folder / package
        yield folder / "share" / package
        if folder.name == package or _states(folder / "package.xml", package):
            yield folder


def _states(manifest: Path, package: str) -> bool:
    """Return whether a package.xml is that of the package."""
    try:
        return ElementTree.parse(manifest).getroot().findtext("name", "").strip() == package
    except (OSError, ElementTree.ParseError):
        return False


def _ros_folders() -> Iterator[Path]:
    for variable, inside in _ROS_PATHS.items():
        for folder in os.environ.get(variable, "").split(os.pathsep):
            if folder:
                yield Path(folder) / inside


def with_followers(urdf: Path, text: str, locked: Mapping[str, float]) -> dict[str, float]:
    """Return positions of locked joints, with those of the joints that follow them (``<mimic>``).

    Raises:
        FileInputError: a joint follows one that is not locked, or none.
    """
    every = dict(locked)
    joints = ElementTree.fromstring(text).findall("joint")
    # a fixed joint stays where it is, whatever it is said to follow
    still = {**dict.fromkeys([j.get("name", "") for j in joints if j.get("type") == "fixed"], 0.0), **locked}
    followers = {
        joint.get("name", ""): mimic
        for joint in joints
        if (mimic := joint.find("mimic")) is not None and joint.get("name") not in still
    }
    for name in followers:
        chain = [name]
        while chain[-1] in followers and len(chain) <= len(followers):
            chain.append(followers[chain[-1]].get("joint", ""))
        if chain[-1] not in still:
            rule = f"follows {chain[-1]!r} (mimic), which moves: lock that joint, or both"
            raise FileInputError(urdf, f"joint {name}", None, rule)
        position = still[chain[-1]]
        for follower in reversed(chain[:-1]):
            mimic = followers[follower]
            position *= _mimic_number(urdf, follower, mimic, "multiplier", "1")
            position += _mimic_number(urdf, follower, mimic, "offset", "0")
        every[name] = position
    return every


def _mimic_number(urdf: Path, joint: str, mimic: ElementTree.Element, key: str, default: str) -> float:
    value = mimic.get(key, default)
    try:
        return float(value)
    except ValueError as error:
        raise FileInputError(urdf, f"joint {joint}: {key}", value, "must be a number") from error


def read_disabled_collisions(
    srdf: Path, text: str, bodies: Mapping[str, Sequence[str]], links: Collection[str]
) -> Pairs:
    """Return the pairs of bodies of an SRDF's disabled collisions: all bodies of one link with all of the other.

    ``disable_default_collisions`` disables a link against all others; ``enable_collisions`` enables a pair again
    (MoveIt's SRDF).

    Args:
        srdf: the file, for messages.
        text: its text; "" if there is none.
        bodies: names of the bodies of each link.
        links: names of all links of the URDF, with those that have no bodies.

    Raises:
        FileInputError: not XML, not an SRDF, a pair without its links, or a name like one of `links` that is none.
            Quite other names may be there: of a tool's bodies, and of a hand that this URDF does not have.
    """
    if not text:
        return frozenset()
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise FileInputError(srdf, "", None, f"is not XML: {error}") from error
    if root.tag != "robot":
        raise FileInputError(srdf, "", None, f"is not an SRDF: it begins with <{root.tag}>, must be <robot>")
    if root.find("link") is not None or root.find("joint") is not None:
        raise FileInputError(srdf, "", None, "is a URDF: an SRDF has no <link> and no <joint>")
    known = {*links, *bodies, *(name for named in bodies.values() for name in named)}
    pairs = {
        frozenset((alone, other))
        for alone in (_named(srdf, e, "link", known) for e in root.findall("disable_default_collisions"))
        for other in bodies
        if other != alone
    }
    pairs -= {_pair(srdf, e, known) for e in root.findall("enable_collisions")}
    pairs |= {_pair(srdf, e, known) for e in root.findall("disable_collisions")}
    _require_of_this_robot(srdf, root, known, links)
    return bodies_of(pairs, bodies)


def _require_of_this_robot(
    srdf: Path, root: ElementTree.Element, known: Collection[str], links: Collection[str]
) -> None:
    """Refuse an SRDF of several pairs, none of which is of links of the URDF; a few may be of a tool's bodies."""
    pairs = [(e.get("link1", ""), e.get("link2", "")) for e in root.findall("disable_collisions")]
    if len(pairs) >= _SEVERAL and not any(a in known and b in known for a, b in pairs):
        shown = " - ".join(pairs[0])
        rule = f"{shown} and all others are no pairs of links of the URDF, which are {', '.join(links)}"
        raise FileInputError(srdf, "disable_collisions", None, rule, "is it of another robot?")


def bodies_of(links: Iterable[frozenset[str]], bodies: Mapping[str, Sequence[str]]) -> Pairs:
    """Return the pairs of bodies of pairs of links; other names are names of bodies."""
    return frozenset(
        frozenset(pair)
        for names in links
        for a, b in combinations(sorted(names), 2)
        for pair in product(bodies.get(a, (a,)), bodies.get(b, (b,)))
    )


def _pair(srdf: Path, element: ElementTree.Element, known: Collection[str]) -> frozenset[str]:
    return frozenset(_named(srdf, element, key, known) for key in ("link1", "link2"))


def _named(srdf: Path, element: ElementTree.Element, key: str, known: Collection[str]) -> str:
    name = element.get(key)
    if not name:
        raise FileInputError(srdf, element.tag, None, f"has no {key}; must name links of the URDF")
    guess = difflib.get_close_matches(name, sorted(known), n=1, cutoff=_ALIKE)
    if guess and name not in known and re.sub(r"\d", "", name) != re.sub(r"\d", "", guess[0]):
        help = f"did you mean {guess[0]!r}?"
        raise FileInputError(srdf, f"{element.tag} {key}", name, "is no link of the URDF", help)
    return name
