"""ROS package of asrsim's messages: equal to the messages of logs and live runs, and readable for ROS."""

import re
from xml.etree import ElementTree

from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from asrsim.log.topics import OWN_MESSAGES
from support.paths import ROOT

PACKAGE = ROOT / "ros" / "asrsim_msgs"


def test_message_definitions_equal_those_of_the_logs():
    assert {path.stem: path.read_text() for path in (PACKAGE / "msg").glob("*.msg")} == OWN_MESSAGES


def test_the_build_lists_all_messages():
    build = (PACKAGE / "CMakeLists.txt").read_text()
    assert set(re.findall(r"msg/(\w+)\.msg", build)) == set(OWN_MESSAGES)
    package = ElementTree.parse(PACKAGE / "package.xml").getroot()
    assert package.findtext("name") == "asrsim_msgs"
    assert package.findtext("member_of_group") == "rosidl_interface_packages"


def test_ros_reads_all_messages():
    types = get_typestore(Stores.ROS2_HUMBLE)
    for name, text in OWN_MESSAGES.items():
        types.register(get_types_from_msg(text, f"asrsim_msgs/msg/{name}"))
        assert types.generate_msgdef(f"asrsim_msgs/msg/{name}")[0]
