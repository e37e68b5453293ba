"""Random damage to robot files: values, attributes, elements and bytes are replaced, duplicated or removed."""

import re

from lxml import etree

VALUES = (
    "1e308", "-1e308", "1e-308", "5e-324", "nan", "-inf", "inf", "0", "-0", "-1", "", " ", "x", "0 0 0", "1 2", "0 0 0 0",
    "true", "9" * 30, "9" * 400, "1*2", "pow(9,999)", "pow(0,-1)", "1/0", "(" * 50, "\u00e9", "\u00a01", "\u0661", "1_0",
    "0x1F", "1e5", "-1e5", "1e12", "1e13", "world", "arm", "elbow", "revolute", "fixed", "floating", "package://a/b.stl",
    "a.stl", "../../etc/passwd", "file:///dev/zero", "&#9;1&#10;", "&#155;", "\u202e", "--", "]]&gt;", "${1+1}", "1,5", ".",
)  # fmt: skip


def damaged(text, source):
    """Text with one to four random faults."""
    for _ in range(source.randint(1, 4)):
        text = source.choice(DAMAGES)(text, source)
    data = text.encode("utf-8", "surrogatepass")
    if source.random() < 0.15:
        spot = source.randrange(len(data) or 1)
        data = data[:spot] + bytes([source.randrange(256)]) + data[spot + source.randint(0, 2) :]
    return data


def _replaced(pattern, new):
    """Function that replaces a random match of the pattern in a text, if there is a match."""

    def damage(text, source):
        spots = list(re.finditer(pattern, text))
        if not spots:
            return text
        spot = source.choice(spots)
        return text[: spot.start()] + new(spot.group(), source) + text[spot.end() :]

    return damage


def _other_attribute(old, source):
    return source.choice(["", old + ' other="1"', old.replace("=", "s=", 1), old * 2])


_value = _replaced(r'(?<==")[^"<>]*(?=")|(?<=>)[^<>\s]+(?=</)', lambda _, source: source.choice(VALUES))
_digit = _replaced(r"(?<=[\" \d])[\d.e-](?=[\" \d])", lambda _, source: source.choice("0123456789.e-+ "))
_attribute = _replaced(r'\s[\w:]+="[^"<>]*"', _other_attribute)


def _tree(text, source):
    """Text in which an element is removed, duplicated, renamed, or copied into another element."""
    try:
        root = etree.fromstring(text.encode(), etree.XMLParser(resolve_entities=False))
    except (etree.XMLSyntaxError, ValueError):
        return text
    found = [element for element in root.iter() if isinstance(element.tag, str) and element is not root]
    if not found:
        return text
    element, other = source.choice(found), source.choice([*found, root])
    parent, what = element.getparent(), source.randrange(4)
    copy = etree.fromstring(etree.tostring(element, with_tail=False))
    if what == 0:
        parent.remove(element)
    elif what == 1:
        parent.append(copy)
    elif what == 2:
        element.tag = source.choice([each.tag for each in found])
    else:
        other.append(copy)
    return str(etree.tostring(root, encoding="unicode"))


def _line(text, source):
    lines = text.splitlines()
    if lines:
        lines.insert(source.randrange(len(lines)), lines.pop(source.randrange(len(lines))))
    return "\n".join(lines)


DAMAGES = (_value, _value, _value, _digit, _attribute, _tree, _tree, _line)
