//! What is read from a peer's certificate, which rustls has verified by then.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

use rustls::pki_types::CertificateDer;
use x509_parser::prelude::{FromDer, X509Certificate};
use zenoh_result::{ZResult, zerror};

/// Of whom a certificate is, and until when.
#[derive(Debug)]
pub(crate) struct Holder {
    /// The common name.
    pub(crate) name: String,
    /// Its end.
    pub(crate) until: SystemTime,
}

/// Reads the first certificate of a chain.
pub(crate) fn holder(chain: Option<&[CertificateDer<'_>]>) -> ZResult<Holder> {
    let first = chain.and_then(<[_]>::first).ok_or_else(|| zerror!("no certificate was shown"))?;
    let (_, certificate) = X509Certificate::from_der(first).map_err(|e| zerror!("its certificate: {e}"))?;
    let name = certificate.subject().iter_common_name().next().and_then(|name| name.as_str().ok());
    let name = name.ok_or_else(|| zerror!("its certificate names nobody"))?.to_owned();
    let seconds = u64::try_from(certificate.validity().not_after.timestamp()).unwrap_or(0);
    Ok(Holder { name, until: UNIX_EPOCH + Duration::from_secs(seconds) })
}
