//! rmw_zenoh's names: the key of a topic, the token by which others see that it is there, and what goes with a message.
//!
//! From Lyrical (0.10.5) on, a message that holds a list of bytes does not go to its topic's key, unless it is kept for
//! those who come late. It goes to a key below for all whose token says that they take it from the processor's memory, and to
//! a key for each other subscription alone. `tests/data/rmw-zenoh.jsonl` has both kinds of key.

use xxhash_rust::xxh3::xxh3_128;

use crate::wire::clock::Clocks;
use crate::wire::messages::Message;

/// Where a type has no hash: ROS 2 Humble.
const NO_HASH: &str = "TypeHashNotSupported";
/// Ends the key of a message for all who take it from the processor's memory.
const IN_MEMORY: &str = "_buf_cpu";
/// Ends the token of who does. Releases before do not read it.
const TAKES_FROM_MEMORY: &str = "/backends:cpu:";

/// Publishes or subscribes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// `MP`.
    Publisher,
    /// `MS`.
    Subscription,
}

/// What of a topic stands in its keys.
#[derive(Clone, Copy, Debug)]
pub struct Topic<'a> {
    /// Fully qualified: `/camera/image_raw`.
    pub name: &'a str,
    /// Such as `sensor_msgs::msg::dds_::Image_`.
    pub kind: &'a str,
    /// Such as `RIHS01_…`.
    pub hash: &'a str,
    /// Its messages hold a list of bytes.
    pub buffers: bool,
}

impl<'a> Topic<'a> {
    /// The topic of this name that has messages `M`.
    #[must_use]
    pub fn of<M: Message>(name: &'a str) -> Self {
        Topic { name, kind: M::TYPE, hash: M::HASH, buffers: M::BUFFERS }
    }
}

/// Our node, as others see it.
#[derive(Clone, Debug)]
pub struct Node {
    /// `ROS_DOMAIN_ID`.
    pub domain: u32,
    /// The session's number.
    pub session: String,
    /// Without a slash; its namespace is the root.
    pub name: String,
    /// Type hashes are sent: every release from Iron on.
    pub hashes: bool,
}

impl Node {
    fn hash<'a>(&self, topic: &Topic<'a>) -> &'a str {
        if self.hashes { topic.hash } else { NO_HASH }
    }

    /// The key to publish on.
    #[must_use]
    pub fn key(&self, topic: &Topic<'_>) -> String {
        format!("{}/{}/{}/{}", self.domain, topic.name.trim_matches('/'), topic.kind, self.hash(topic))
    }

    /// The keys to subscribe to: any release's hash.
    #[must_use]
    pub fn heard_on(&self, topic: &Topic<'_>) -> Vec<String> {
        let any_hash = format!("{}/{}/{}/*", self.domain, topic.name.trim_matches('/'), topic.kind);
        let in_memory = topic.buffers.then(|| format!("{any_hash}/{IN_MEMORY}"));
        std::iter::once(any_hash).chain(in_memory).collect()
    }

    /// The node's own token.
    #[must_use]
    pub fn token(&self) -> String {
        format!("@ros2_lv/{}/{}/0/0/NN/%/%/{}", self.domain, self.session, self.name)
    }

    /// The token of the node's end `id` of a topic: reliable, volatile, the last ten; a subscription best effort, so that
    /// it goes with every publisher.
    #[must_use]
    pub fn end_token(&self, id: u32, end: End, topic: &Topic<'_>) -> String {
        let (end, qos, takes) = match end {
            End::Publisher => ("MP", "::,10:,:,:,,", ""),
            End::Subscription if topic.buffers => ("MS", "2::,10:,:,:,,", TAKES_FROM_MEMORY),
            End::Subscription => ("MS", "2::,10:,:,:,,", ""),
        };
        let name = format!("/{}", topic.name.trim_matches('/')).replace('/', "%");
        let (domain, session, node) = (self.domain, &self.session, &self.name);
        let (kind, hash) = (topic.kind, self.hash(topic));
        format!("@ros2_lv/{domain}/{session}/0/{id}/{end}/%/%/{node}/{name}/{kind}/{hash}/{qos}{takes}")
    }
}

/// The number that rmw_zenoh knows the owner of `token` by.
#[must_use]
pub fn gid(token: &str) -> [u8; 16] {
    xxh3_128(token.as_bytes()).to_le_bytes()
}

/// What rmw_zenoh attaches to a message: its number from its publisher, when it was sent, and whose it is.
#[must_use]
pub fn attachment(sequence: i64, sent: &Clocks, gid: &[u8; 16]) -> [u8; 33] {
    let mut bytes = [0; 33];
    bytes[..8].copy_from_slice(&sequence.to_le_bytes());
    bytes[8..16].copy_from_slice(&sent.system.to_le_bytes());
    bytes[16] = 16; // as Zenoh's serializer has it, a list begins with its length
    bytes[17..].copy_from_slice(gid);
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    const CHATTER: Topic<'_> = Topic {
        name: "/chatter",
        kind: "std_msgs::msg::dds_::String_",
        hash: "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
        buffers: false,
    };

    fn node(session: &str, name: &str) -> Node {
        Node { domain: 0, session: session.to_owned(), name: name.to_owned(), hashes: true }
    }

    // The wanted keys are those that rmw_zenoh's own design page shows of a talker and a listener of its.
    #[test]
    fn keys_and_tokens_are_those_of_rmw_zenohs_own_example() {
        let talker = node("8b20917502ee955ac4476e0266340d5c", "talker");
        let hash = CHATTER.hash;
        assert_eq!(talker.key(&CHATTER), format!("0/chatter/std_msgs::msg::dds_::String_/{hash}"));
        assert_eq!(
            talker.end_token(10, End::Publisher, &CHATTER).replace(",10:", ",7:"),
            format!(
                "@ros2_lv/0/8b20917502ee955ac4476e0266340d5c/0/10/MP/%/%/talker/%chatter/\
                 std_msgs::msg::dds_::String_/{hash}/::,7:,:,:,,"
            )
        );
        let listener = node("aac3178e146ba6f1fc6e6a4085e77f21", "listener");
        assert_eq!(listener.token(), "@ros2_lv/0/aac3178e146ba6f1fc6e6a4085e77f21/0/0/NN/%/%/listener");
        assert_eq!(
            listener.end_token(10, End::Subscription, &CHATTER).replace("/2::", "/::"),
            format!(
                "@ros2_lv/0/aac3178e146ba6f1fc6e6a4085e77f21/0/10/MS/%/%/listener/%chatter/\
                 std_msgs::msg::dds_::String_/{hash}/::,10:,:,:,,"
            )
        );
    }

    #[test]
    fn a_name_in_a_namespace_keeps_its_slashes_in_the_key_and_not_in_the_token() {
        let (topic, node) = (Topic { name: "/robot/chatter", ..CHATTER }, node("1", "a"));
        assert_eq!(node.heard_on(&topic), ["0/robot/chatter/std_msgs::msg::dds_::String_/*"]);
        assert!(node.end_token(1, End::Publisher, &topic).contains("/%robot%chatter/"));
    }

    #[test]
    fn what_holds_bytes_is_taken_from_memory_too_and_a_publisher_says_nothing_of_it() {
        let (topic, node) = (Topic { buffers: true, ..CHATTER }, node("1", "a"));
        let plain = "0/chatter/std_msgs::msg::dds_::String_/*";
        assert_eq!(node.heard_on(&topic), [plain.to_owned(), format!("{plain}/_buf_cpu")]);
        assert!(node.end_token(1, End::Subscription, &topic).ends_with(":,:,,/backends:cpu:"));
        assert_eq!(node.end_token(1, End::Publisher, &topic), node.end_token(1, End::Publisher, &CHATTER));
    }

    #[test]
    fn humble_has_no_hashes() {
        let humble = Node { hashes: false, ..node("1", "a") };
        assert!(humble.key(&CHATTER).ends_with("/TypeHashNotSupported"));
        assert!(humble.end_token(1, End::Publisher, &CHATTER).contains("/TypeHashNotSupported/"));
    }

    // Of nothing XXH3 is 99aa06d3014798d8 6001c324468d497f, by its own specification; the lower half goes first.
    #[test]
    fn a_gid_is_the_tokens_xxh3_with_its_lower_half_first() {
        let of_nothing = 0x99aa_06d3_0147_98d8_6001_c324_468d_497f_u128;
        assert_eq!(gid(""), of_nothing.to_le_bytes());
        assert_ne!(gid("a"), gid("b"));
    }

    #[test]
    fn an_attachment_is_two_numbers_and_a_list_of_sixteen_bytes() {
        let sent = Clocks { monotonic: 0, system: 0x0102_0304_0506_0708 };
        let bytes = attachment(5, &sent, &[9; 16]);
        assert_eq!(bytes[..17], [5, 0, 0, 0, 0, 0, 0, 0, 8, 7, 6, 5, 4, 3, 2, 1, 16]);
        assert_eq!(bytes[17..], [9; 16]);
    }
}
