//! What a real rmw_zenoh said, of Jazzy and of Lyrical, against our names, bytes and subscriptions.
#![allow(clippy::unwrap_used, reason = "test helpers too")]

use std::fmt::Debug;
use std::fs;
use std::path::Path;

use goshawk_ros2::wire::cdr;
use goshawk_ros2::wire::clock::Clocks;
use goshawk_ros2::wire::graph::{self, End, Node, Topic};
use goshawk_ros2::wire::messages::{
    CameraInfo, CompressedImage, Image, MarkerArray, Message, Odometry, Path as RosPath, PoseStamped,
    PoseWithCovarianceStamped, TfMessage,
};
use serde::Deserialize;
use zenoh::key_expr::KeyExpr;

/// A line of the recording: a token, or a message with what came with it.
#[derive(Deserialize)]
#[serde(untagged)]
enum Row {
    Token { token: String },
    Sample(Sample),
}

#[derive(Deserialize)]
struct Sample {
    topic: String,
    r#type: String,
    key: String,
    gid: String,
    payload: String,
    attachment: String,
    /// The same message in rosbags' bytes.
    rosbags: String,
}

fn recorded() -> (Vec<String>, Vec<Sample>) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../tests/data/rmw-zenoh.jsonl");
    let (mut tokens, mut samples) = (Vec::new(), Vec::new());
    for line in fs::read_to_string(path).unwrap().lines() {
        match serde_json::from_str(line).unwrap() {
            Row::Token { token } => tokens.push(token),
            Row::Sample(sample) => samples.push(sample),
        }
    }
    (tokens, samples)
}

fn bytes(hex: &str) -> Vec<u8> {
    (0..hex.len()).step_by(2).map(|at| u8::from_str_radix(&hex[at..at + 2], 16).unwrap()).collect()
}

fn node(session: &str, name: &str) -> Node {
    Node { domain: 0, session: session.to_owned(), name: name.to_owned(), hashes: true }
}

/// Its bytes are the message that rosbags read, its key is ours, and our subscription hears it.
fn check<'a, M: Message + Deserialize<'a> + PartialEq + Debug>(sample: &Sample, ours: &'a [u8], theirs: &'a [u8]) {
    assert_eq!(cdr::decode::<M>(ours).unwrap(), cdr::decode::<M>(theirs).unwrap(), "{}", sample.key);
    let (topic, node) = (Topic::of::<M>(&sample.topic), node("1", "a"));
    assert!(sample.key.starts_with(&node.key(&topic)), "{} is not on {}", sample.key, node.key(&topic));
    let key = KeyExpr::new(&sample.key).unwrap();
    let heard = node.heard_on(&topic).into_iter().filter(|ours| KeyExpr::new(ours).unwrap().includes(&key)).count();
    assert_eq!(
        heard,
        usize::from(!sample.key.contains("/_buf/")),
        "{}: what is another's alone is not heard",
        sample.key
    );
}

#[test]
fn a_real_nodes_messages_are_read_as_rosbags_reads_them_on_the_keys_that_are_heard() {
    let (_, samples) = recorded();
    for sample in &samples {
        let (ours, theirs) = (bytes(&sample.payload), bytes(&sample.rosbags));
        let check = match sample.r#type.as_str() {
            "sensor_msgs/msg/Image" => check::<Image<'_>>,
            "sensor_msgs/msg/CompressedImage" => check::<CompressedImage<'_>>,
            "sensor_msgs/msg/CameraInfo" => check::<CameraInfo>,
            "nav_msgs/msg/Odometry" => check::<Odometry>,
            "nav_msgs/msg/Path" => check::<RosPath>,
            "geometry_msgs/msg/PoseStamped" => check::<PoseStamped>,
            "geometry_msgs/msg/PoseWithCovarianceStamped" => check::<PoseWithCovarianceStamped>,
            "tf2_msgs/msg/TFMessage" => check::<TfMessage>,
            "visualization_msgs/msg/MarkerArray" => check::<MarkerArray>,
            other => panic!("a message of no type of ours: {other}"),
        };
        check(sample, &ours, &theirs);
    }
    let kinds: std::collections::BTreeSet<_> = samples.iter().map(|sample| &sample.r#type).collect();
    assert_eq!(kinds.len(), 9, "{kinds:?}");
}

#[test]
fn a_real_attachment_is_ours_and_its_gid_is_that_of_a_publishers_token() {
    let (tokens, samples) = recorded();
    for sample in &samples {
        let (real, gid) = (bytes(&sample.attachment), <[u8; 16]>::try_from(bytes(&sample.gid)).unwrap());
        let number = |at: usize| i64::from_le_bytes(real[at..at + 8].try_into().unwrap());
        let sent = Clocks { monotonic: 0, system: number(8) };
        assert_eq!(graph::attachment(number(0), &sent, &gid)[..], real[..], "{}", sample.key);
        let of = tokens.iter().find(|token| graph::gid(token) == gid).unwrap();
        assert!(of.contains("/MP/") && of.contains(&sample.topic.replace('/', "%")), "{of}");
    }
}

#[test]
fn a_real_nodes_tokens_are_as_ours_would_be() {
    let (tokens, _) = recorded();
    let mut compared = 0;
    for token in &tokens {
        let parts: Vec<&str> = token.split('/').collect();
        // Of the recorded nodes one is in the root's namespace, as ours is.
        let [_, "0", session, "0", id, end, "%", "%", name, rest @ ..] = &parts[..] else { continue };
        let ours = node(session, name);
        let [topic, kind, hash, "::,10:,:,:,,"] = rest else {
            assert!(*end != "NN" || *token == ours.token());
            continue;
        };
        let topic = topic.replace('%', "/");
        let topic = Topic { name: &topic, kind, hash, buffers: false };
        assert_eq!(*token, ours.end_token(id.parse().unwrap(), End::Publisher, &topic));
        compared += 1;
    }
    assert!(compared >= 9, "{compared}");
}

#[test]
fn a_subscription_to_images_says_what_a_real_one_of_lyrical_says() {
    let (tokens, _) = recorded();
    let topic = Topic::of::<Image<'_>>("/camera");
    let last = |token: &str| token.rsplit('/').next().map(str::to_owned);
    let ours = last(&node("1", "a").end_token(1, End::Subscription, &topic));
    let lyrical: Vec<_> = tokens.iter().filter(|token| token.contains("/MS/") && token.contains("/backends")).collect();
    assert!(!lyrical.is_empty());
    assert!(lyrical.iter().all(|token| last(token) == ours), "{ours:?} {lyrical:?}");
}
