//! Zenoh's access list, from the roles of the key table.

use goshawk_proto::keys::{Key, Kind, PREFIX, Role, VehicleName};
use serde_json::{Value, json};

use super::Identity;

const ALL: [&str; 9] = [
    "put",
    "delete",
    "declare_subscriber",
    "query",
    "declare_queryable",
    "reply",
    "liveliness_token",
    "declare_liveliness_subscriber",
    "liveliness_query",
];

/// Grounds by their certificates, sensors by the unix socket.
pub(super) fn of_identity(vehicle: &VehicleName, identity: &Identity) -> Value {
    list(
        vehicle,
        &[
            (Role::Sensor, json!({"id": "sensor", "link_protocols": ["unixsock-stream"]})),
            (Role::Operator, by_certificate("operator", &identity.operators())),
            (Role::Observer, by_certificate("observer", &identity.observers())),
        ],
    )
}

/// Whoever connects is an operator, but only this host has sensors.
pub(super) fn of_interfaces(vehicle: &VehicleName) -> Value {
    list(
        vehicle,
        &[
            (Role::Sensor, json!({"id": "sensor", "interfaces": ["lo"]})),
            (Role::Sensor, json!({"id": "socket", "link_protocols": ["unixsock-stream"]})),
            (Role::Operator, json!({"id": "anybody"})),
        ],
    )
}

fn by_certificate(id: &str, names: &[String]) -> Value {
    // A list may not be empty; nobody has this name, for it is no name that is given out.
    let nobody = [format!("{id}.")];
    json!({"id": id, "cert_common_names": if names.is_empty() { &nobody } else { names }})
}

fn list(vehicle: &VehicleName, subjects: &[(Role, Value)]) -> Value {
    // What goes out goes to a subscriber or an asker, which was judged when it came: but to nobody else.
    let outward = json!({
        "id": "outward", "permission": "allow", "flows": ["egress"], "messages": ALL,
        "key_exprs": [format!("{PREFIX}/{vehicle}/**")],
    });
    let mut rules = vec![outward.clone()];
    let mut policies = Vec::new();
    for (role, subject) in subjects {
        let id = subject["id"].as_str().unwrap_or_default();
        let own: Vec<Value> = rights(*role)
            .into_iter()
            .enumerate()
            .map(|(k, (messages, keys))| {
                let expressions: Vec<String> = keys.iter().map(|key| key.expression(vehicle)).collect();
                json!({
                    "id": format!("{id} {k}"), "permission": "allow", "flows": ["ingress"],
                    "messages": messages, "key_exprs": expressions,
                })
            })
            .collect();
        let ids = own.iter().map(|rule| &rule["id"]).chain([&outward["id"]]).collect::<Vec<_>>();
        policies.push(json!({"rules": ids, "subjects": [id]}));
        rules.extend(own);
    }
    let subjects: Vec<&Value> = subjects.iter().map(|(_, subject)| subject).collect();
    json!({
        "enabled": true, "default_permission": "deny",
        "rules": rules, "subjects": subjects, "policies": policies,
    })
}

/// What a role may send to the vehicle: kinds of message, and on which keys.
fn rights(role: Role) -> Vec<(&'static [&'static str], Vec<Key>)> {
    let keys = |kind: Kind, sends: bool| -> Vec<Key> {
        let roles = |key: &Key| if sends { key.row().from } else { key.row().to };
        Key::ALL.into_iter().filter(|key| key.row().kind == kind && roles(key).contains(&role)).collect()
    };
    let all: [(&'static [&'static str], Vec<Key>); 6] = [
        (&["put"], keys(Kind::Pub, true)),
        (&["declare_subscriber"], keys(Kind::Pub, false)),
        (&["query"], keys(Kind::Query, true)),
        (&["declare_queryable", "reply"], keys(Kind::Query, false)),
        (&["liveliness_token"], keys(Kind::Liveliness, true)),
        (&["declare_liveliness_subscriber", "liveliness_query"], keys(Kind::Liveliness, false)),
    ];
    all.into_iter().filter(|(_, keys)| !keys.is_empty()).collect()
}

/// A question to the vehicle is short.
pub(super) fn low_pass(vehicle: &VehicleName, bytes: usize) -> Value {
    let keys: Vec<String> = questions().map(|key| key.expression(vehicle)).collect();
    json!([{
        "id": "questions", "flows": ["ingress"], "messages": ["query"], "key_exprs": keys, "size_limit": bytes,
    }])
}

/// Of each peer no more questions of a kind than this are listened to.
pub(super) fn downsampling(vehicle: &VehicleName, hz: f64) -> Value {
    let rules: Vec<Value> = questions().map(|key| json!({"key_expr": key.expression(vehicle), "freq": hz})).collect();
    json!([{"id": "questions", "flows": ["ingress"], "messages": ["query"], "rules": rules}])
}

fn questions() -> impl Iterator<Item = Key> {
    Key::ALL.into_iter().filter(|key| key.row().kind == Kind::Query && key.row().to.contains(&Role::Vehicle))
}
