"""Names, tokens and attachments equal the examples in docs/design.md of ros2/rmw_zenoh."""

from phalanx_ros2.rmw_zenoh import MessageType, NodeName, attachment, gid
from zenoh import ZBytes
from zenoh.ext import Int64, z_deserialize

DIGEST = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
STRING = MessageType("std_msgs/msg/String", DIGEST)
TALKER = NodeName(2, "/", "talker")
ZID = "8b20917502ee955ac4476e0266340d5c"


def test_a_topics_key_expression_is_that_of_the_design():
    node = NodeName(0, "/", "talker")
    assert node.topic_key("/chatter", STRING) == f"0/chatter/std_msgs::msg::dds_::String_/{DIGEST}"
    below = node.topic_key("/robot1/chatter", STRING)
    assert below == f"0/robot1/chatter/std_msgs::msg::dds_::String_/{DIGEST}"


def test_a_nodes_token_is_that_of_the_design():
    listener = NodeName(2, "/", "listener").token("aac3178e146ba6f1fc6e6a4085e77f21")
    assert listener == "@ros2_lv/2/aac3178e146ba6f1fc6e6a4085e77f21/0/0/NN/%/%/listener"


def test_a_publishers_token_is_that_of_the_design_with_the_depth_of_its_subscription():
    token = TALKER.publisher_token(ZID, 10, "/chatter", STRING)
    assert token == (
        f"@ros2_lv/2/{ZID}/0/10/MP/%/%/talker/%chatter/std_msgs::msg::dds_::String_/{DIGEST}"
        "/::,10:,:,:,,"
    )


def test_slashes_of_names_are_no_slashes_of_a_token():
    token = NodeName(0, "/a/b", "swarm").publisher_token(ZID, 3, "/a/b/markers", STRING)
    assert token.split("/")[5:10] == ["MP", "%", "%a%b", "swarm", "%a%b%markers"]


def test_an_attachment_is_what_zenohs_own_deserializer_reads():
    """rmw_zenoh serializes the three in turn: attachment_helpers.cpp."""
    written = attachment(7, 1_700_000_000_123_456_789, bytes(range(16)))
    assert len(written) == 33
    read = z_deserialize(tuple[Int64, Int64, bytes], ZBytes(written))
    assert read == (7, 1_700_000_000_123_456_789, bytes(range(16)))


def test_a_gid_is_the_128_bits_of_xxh3_its_low_half_first():
    """XXH128 of nothing is 99aa06d3014798d86001c324468d497f: xxHash's own test."""
    assert gid("").hex() == "7f498d4624c30160" + "d8984701d306aa99"
    assert gid(TALKER.token(ZID)) != gid(TALKER.token(ZID[::-1]))


def test_a_subscriptions_token_differs_from_a_publishers_in_its_kind_alone():
    publisher = TALKER.publisher_token(ZID, 10, "/chatter", STRING)
    token = TALKER.subscription_token(ZID, 10, "/chatter", STRING)
    assert token == publisher.replace("/MP/", "/MS/") != publisher
