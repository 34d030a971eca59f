"""Preparation of a URDF for Pinocchio (continuous joints, mesh files), and disabled collisions from its SRDF.

Mesh names follow ROS: ``package://PACKAGE/path`` (or ``model://``), ``file:///path``, or a path relative to the URDF.
Packages are searched in the caller's folders, in the folders above the URDF, and in those of ROS: ROS_PACKAGE_PATH
(ROS 1) and AMENT_PREFIX_PATH (ROS 2, ``<prefix>/share/PACKAGE``).
"""

from __future__ import annotations

import difflib
import os
import re
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import combinations, product
from pathlib import Path
from typing import TypeVar
from urllib.parse import unquote

import numpy as np

from arm.arguments import shown
from arm.errors import FileInputError, InputError
from arm.io.storage import read_text

T = TypeVar("T")
Pairs = frozenset[frozenset[str]]

SAME_NAME = " (joint)"

_TURNS = 2.0 * np.pi  # rad, range of a continuous joint in each direction
_SEVERAL = 5  # pairs of an SRDF, of which one at least is of links of its URDF
_ALIKE = 0.8  # of a misspelt name and the one that is meant; 0.89 of 'uper' and 'upper'
_JOINTS = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
_LIMITED = ("revolute", "prismatic")
_MOVES = (*_LIMITED, "continuous", "planar")  # along or about an axis; others often have one of zeros
_NUMBERS = {"xyz": 3, "rpy": 3, "size": 3, "radius": 1, "length": 1, "lower": 1, "upper": 1, "velocity": 1}
_LARGE = dict.fromkeys(
    ("size", "radius", "length"), (20.0, "m", "is it in mm?")
)  # of a link, as of its meshes
_LARGE["rpy"] = (2.0 * np.pi + 0.01, "rad", "is it in degrees?")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,3})?", re.ASCII)
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
    if any("xacro" in element.tag for element in root.iter()):
        raise _is_xacro(urdf)
    parts = [*root.findall("link"), *root.findall("joint")]  # not what simulators read, such as <gazebo>
    for part in parts:
        values = (value for element in part.iter() for value in element.attrib.values())
        if any("${" in value or "$(" in value for value in values):
            raise _is_xacro(urdf)
    _require_tree(urdf, root)
    for part in parts:
        _require_numbers(urdf, part)
    return root


def _require_tree(urdf: Path, root: ElementTree.Element) -> None:
    """Require links with different names that known joints connect, all to one base; else raise FileInputError."""
    links, joints = root.findall("link"), root.findall("joint")
    if root.tag != "robot":
        raise FileInputError(urdf, "", None, f"is not a URDF: it begins with <{root.tag}>, must be <robot>")
    if not links:
        raise FileInputError(urdf, "", None, "is not a URDF: it has no <link>", "is it an SRDF?")
    names = [link.get("name", "") for link in links]
    for kind, parts in (("link", links), ("joint", joints)):
        listed = [part.get("name", "") for part in parts]
        if twice := next((name for name in listed if name and listed.count(name) > 1), None):
            raise FileInputError(urdf, f"{kind} name", twice, "is used twice; names must differ")
    movers = dict[str, str]()
    for joint in joints:
        name = f"joint {joint.get('name')}"
        kind = joint.get("type", "")
        if kind not in _JOINTS:
            raise FileInputError(
                urdf, f"{name}: type", kind, f"must be one of {', '.join(_JOINTS)}", _near(kind, _JOINTS)
            )
        parent, child = (
            getattr(joint.find(end), "attrib", {}).get("link", "") for end in ("parent", "child")
        )
        for end, link in (("parent", parent), ("child", child)):
            if link not in names:
                rule = f"must name a link of the URDF, which are {', '.join(names)}"
                raise FileInputError(urdf, f"{name}: {end}", link, rule, _near(link, names))
        if child in movers or child == parent:
            other = "its parent" if child == parent else f"that of joint {movers[child]}"
            rule = f"is {other} too; a joint moves one link, and a link is moved by one joint"
            raise FileInputError(urdf, f"{name}: child", child, rule)
        movers[child] = joint.get("name", "")
        if kind in _LIMITED:
            limit = joint.find("limit")
            if limit is None or limit.get("velocity") is None:
                found = "no <limit>" if limit is None else "a <limit> without velocity"
                rule = f"has {found}; must have one with lower, upper and velocity"
                raise FileInputError(
                    urdf, name, None, rule, 'one that turns without end is type="continuous"'
                )
    bases = [name for name in names if name not in movers]
    if len(bases) != 1:
        rule = f"must have one link that no joint moves, its base; it has {', '.join(bases) or 'none'}"
        raise FileInputError(urdf, "", None, rule, "is a joint missing, or are parent and child exchanged?")


def _near(name: str, known: Sequence[str]) -> str:
    guess = difflib.get_close_matches(name, known, n=1)
    return f"did you mean {guess[0]!r}?" if guess else ""


def _require_numbers(urdf: Path, part: ElementTree.Element) -> None:
    """Require numbers, as many as belong there, in what motion and collisions depend on; else raise FileInputError."""
    looked_at = part.findall("collision//*") if part.tag == "link" else [part, *part]
    for element in looked_at:
        for key, count in _NUMBERS.items():
            if (value := element.get(key)) is None:
                continue
            where = f"{part.tag} {part.get('name')}: {element.tag} {key}"
            found = [float(word) for word in value.split() if _NUMBER.fullmatch(word)]
            if len(found) != len(value.split()) or len(found) != count:
                what = f"{count} numbers with spaces between them" if count > 1 else "a number"
                help = (
                    "the decimal sign is a point, and no commas stand between numbers" if "," in value else ""
                )
                raise FileInputError(urdf, where, value, f"must be {what}", help)
            most, unit, help = _LARGE.get(key, (np.inf, "", ""))
            beyond = max if key == "rpy" else min  # a floor may be large along two axes
            if beyond(map(abs, found)) > most:
                raise FileInputError(urdf, where, value, f"must be within {most:.4g} {unit}", help)
            if part.get("type") in _MOVES and (element.tag, key) == ("axis", "xyz") and not any(found):
                raise FileInputError(urdf, where, value, "must not be 0 along all three axes")


def parsed(urdf: Path, read: Callable[[], T]) -> T:
    """Return what a parser of the URDF makes of it. It writes its reasons to standard error: they are caught.

    Raises:
        FileInputError: the parser refuses the file, with the first of its reasons.
    """
    with tempfile.TemporaryFile() as said:
        try:
            with _on_stderr(said.fileno()):
                return read()
        except (ValueError, RuntimeError) as error:
            said.seek(0)
            reasons = re.findall(r"^Error: *(.+)", said.read().decode(errors="replace"), re.M)
            raise FileInputError(urdf, "", None, f"is not a URDF: {[*reasons, error][0]}") from error


@contextmanager
def _on_stderr(file: int) -> Iterator[None]:
    """Write to another file what libraries write to standard error, if there is one."""
    if sys.stderr is None:
        yield
        return
    sys.stderr.flush()
    kept = os.dup(2)
    os.dup2(file, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)


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
    srdf: Path, text: str, bodies: Mapping[str, Sequence[str]], links: Collection[str], robot: str = ""
) -> Pairs:
    """Return the pairs of bodies of an SRDF's disabled collisions: all bodies of one link with all of the other.

    ``disable_default_collisions`` disables a link against all others; ``enable_collisions`` enables a pair again
    (MoveIt's SRDF).

    Args:
        srdf: the file, for messages.
        text: its text; "" if there is none.
        bodies: names of the bodies of each link.
        links: names of all links of the URDF, with those that have no bodies.
        robot: name of the URDF's robot.

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
    _require_of_this_robot(srdf, root, known, links, robot)
    return bodies_of(pairs, bodies)


def _require_of_this_robot(
    srdf: Path, root: ElementTree.Element, known: Collection[str], links: Collection[str], robot: str
) -> None:
    """Refuse an SRDF of another name or of several pairs, none of which is of links of the URDF.

    A few of the same name may be of a tool's bodies.
    """
    pairs = [(e.get("link1", ""), e.get("link2", "")) for e in root.findall("disable_collisions")]
    least = _SEVERAL if root.get("name", robot) == robot else 1
    if len(pairs) >= least and not any(a in known and b in known for a, b in pairs):
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
