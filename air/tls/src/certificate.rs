//! What is read from a peer's certificate: before it is verified, to name whoever is refused; then, to know it.

use std::sync::{Arc, OnceLock};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use rustls::client::danger::HandshakeSignatureValid;
use rustls::pki_types::{CertificateDer, UnixTime};
use rustls::server::danger::{ClientCertVerified, ClientCertVerifier};
use rustls::{CertificateError, DigitallySignedStruct, DistinguishedName, Error, SignatureScheme};
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

/// Who a peer says that it is: anybody can say anything.
#[derive(Clone, Debug, Default)]
pub(crate) struct Claim(Arc<OnceLock<String>>);

impl Claim {
    /// The common name as it was shown; none: no certificate came that could be read.
    pub(crate) fn name(&self) -> Option<&str> {
        self.0.get().map(String::as_str)
    }
}

/// Whose certificate is good, but who is not one of those that are let in.
pub(crate) const NOT_ADMITTED: Error = Error::InvalidCertificate(CertificateError::ApplicationVerificationFailure);

/// The names that are let in; none: whoever has a good certificate.
pub(crate) type Admitted = Option<Arc<[String]>>;

/// A verifier that hears the name before it judges the certificate.
#[derive(Debug)]
pub(crate) struct Listening {
    judge: Arc<dyn ClientCertVerifier>,
    claim: Claim,
    admitted: Admitted,
}

impl Listening {
    /// `judge` decides whose certificate is good.
    pub(crate) fn new(judge: Arc<dyn ClientCertVerifier>, claim: Claim, admitted: Admitted) -> Self {
        Listening { judge, claim, admitted }
    }
}

impl ClientCertVerifier for Listening {
    fn offer_client_auth(&self) -> bool {
        self.judge.offer_client_auth()
    }

    fn client_auth_mandatory(&self) -> bool {
        self.judge.client_auth_mandatory()
    }

    fn root_hint_subjects(&self) -> &[DistinguishedName] {
        self.judge.root_hint_subjects()
    }

    fn verify_client_cert(
        &self,
        shown: &CertificateDer<'_>,
        between: &[CertificateDer<'_>],
        now: UnixTime,
    ) -> Result<ClientCertVerified, Error> {
        if let Ok(Holder { name, .. }) = holder(Some(std::slice::from_ref(shown))) {
            let _ = self.claim.0.set(name);
        }
        let good = self.judge.verify_client_cert(shown, between, now).map_err(without_times)?;
        let admits = |names: &[String]| self.claim.name().is_some_and(|name| names.iter().any(|one| one == name));
        if self.admitted.as_deref().is_none_or(admits) { Ok(good) } else { Err(NOT_ADMITTED) }
    }

    fn verify_tls12_signature(
        &self,
        message: &[u8],
        certificate: &CertificateDer<'_>,
        signed: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        self.judge.verify_tls12_signature(message, certificate, signed)
    }

    fn verify_tls13_signature(
        &self,
        message: &[u8],
        certificate: &CertificateDer<'_>,
        signed: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        self.judge.verify_tls13_signature(message, certificate, signed)
    }

    fn supported_verify_schemes(&self) -> Vec<SignatureScheme> {
        self.judge.supported_verify_schemes()
    }
}

/// The same refusal is the same line, however often it happens.
fn without_times(error: Error) -> Error {
    match error {
        Error::InvalidCertificate(CertificateError::ExpiredContext { .. }) => CertificateError::Expired.into(),
        Error::InvalidCertificate(CertificateError::NotValidYetContext { .. }) => CertificateError::NotValidYet.into(),
        other => other,
    }
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
