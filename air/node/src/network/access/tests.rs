use super::*;

fn judged(endpoints: &[&str], insecure: bool) -> Result<Guard, AccessError> {
    guard(&endpoints.iter().map(|e| (*e).to_owned()).collect::<Vec<_>>(), insecure, None)
}

#[test]
fn without_an_identity_only_this_host_is_listened_to() {
    for own in ["tcp/127.0.0.1:7447", "tcp/[::1]:7447", "tcp/localhost:7447", "unixsock-stream//run/goshawk/s.sock"] {
        assert_eq!(judged(&[own], false).unwrap(), Guard::ThisHost, "{own}");
    }
    for open in ["tcp/0.0.0.0:7447", "tcp/[::]:7447", "tcp/192.168.1.7:7447", "tcp/goshawk.local:7447", "udp/0.0.0.0:1"]
    {
        assert!(matches!(judged(&[open], false), Err(AccessError::Open(_))), "{open}");
        assert_eq!(judged(&[open], true).unwrap(), Guard::Nobody, "{open}");
    }
    let both = ["tcp/127.0.0.1:7447", "tcp/0.0.0.0:7448"];
    assert!(matches!(judged(&both, false), Err(AccessError::Open(which)) if which == both[1]));
}

#[test]
fn an_encrypted_listener_needs_an_identity_even_where_the_file_says_insecure() {
    for endpoint in ["tls/0.0.0.0:7447", "tls/127.0.0.1:7447"] {
        assert!(matches!(judged(&[endpoint], true), Err(AccessError::NoIdentity(_))), "{endpoint}");
    }
}

#[test]
fn who_is_in_the_group_reaches_the_sensors_socket_whatever_the_umask() {
    let folder = tempfile::tempdir().unwrap();
    let socket = folder.path().join("sensors.sock");
    let listen = vec![format!("unixsock-stream/{}", socket.display())];
    let bus = Access { vehicle: "goshawk".parse().unwrap(), listen, guard: Guard::ThisHost }.listen().unwrap();
    assert_eq!(std::fs::metadata(&socket).unwrap().permissions().mode() & 0o777, 0o660);
    drop(bus);
}
