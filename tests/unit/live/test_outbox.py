"""The outbox of ROS topics tells the user of messages that subscribers do not take in time."""

from asrsim.live.ros import Outbox, message_type


class Publisher:
    """Stand-in for rclpy's publisher: keeps what it sends, or raises its error of a subscriber that does not keep up."""

    def __init__(self, *, blocked=False):
        self.handle, self.blocked, self.sent = self, blocked, []

    def publish_raw(self, message):
        if self.blocked:
            raise RuntimeError("Failed to publish: timeout")
        self.sent.append(message)


def test_the_first_lost_message_is_told_and_the_thousandth_and_no_other():
    told = []
    outbox = Outbox([Publisher(blocked=True)], told.append)
    outbox.send([b"a"], [True])
    assert told == ["1 message dropped so far: a subscriber does not keep up"]
    for _ in range(998):
        outbox.send([b"a"], [True])
    assert len(told) == 1
    outbox.send([b"a"], [True])
    assert told[1:] == ["1000 messages dropped so far: a subscriber does not keep up"]
    outbox.send([b"a"], [True])
    assert len(told) == 2


def test_a_blocked_topic_keeps_no_other_topic_from_its_message():
    blocked, free = Publisher(blocked=True), Publisher()
    Outbox([blocked, free], lambda text: None).send([b"a", b"b"], [True, True])
    assert free.sent == [b"b"]


def test_messages_of_packages_and_kinds_that_are_not_installed_have_no_class(tmp_path, monkeypatch):
    (tmp_path / "odd_msgs").mkdir()
    (tmp_path / "odd_msgs" / "msg.py").write_text("class Odd:\n    pass\n")
    monkeypatch.syspath_prepend(tmp_path)
    assert message_type("odd_msgs/Odd").__name__ == "Odd"
    assert message_type("odd_msgs/Even") is None
    assert message_type("no_such_msgs/Odd") is None


def test_topics_that_nobody_reads_and_empty_messages_are_left_out():
    unread, empty = Publisher(), Publisher()
    Outbox([unread, None, empty], lambda text: None).send([b"a", b"b", b""], [False, False, True])
    assert unread.sent == empty.sent == []
