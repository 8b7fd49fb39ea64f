//! What a ground missed while its link was away, told when it asks: a page a question, one after the other, on a thread
//! that nothing else waits for.

use std::sync::Mutex;
use std::sync::mpsc::Receiver;
use std::time::Duration;

use goshawk_proto::v1;
use prost::Message;
use zenoh::Wait;
use zenoh::query::Query;

use crate::flight::shared::{Shared, lock};
use crate::network::memory::Memory;

/// Answers until the process stops. What cannot be read goes unanswered.
pub fn serve(asked: &Receiver<Query>, memory: &Mutex<Memory>, shared: &Shared) {
    while !shared.stopping() {
        let Ok(query) = asked.recv_timeout(Duration::from_millis(100)) else { continue };
        let payload = query.payload().map(|p| p.to_bytes().into_owned()).unwrap_or_default();
        let Ok(request) = v1::MissedRequest::decode(payload.as_slice()) else { continue };
        let page = lock(memory).page(&request);
        let _ = query.reply(query.key_expr().clone(), page.encode_to_vec()).wait();
    }
}
