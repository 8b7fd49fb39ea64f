//! From Zenoh's `transport/link/tls` to a server that asks for certificates. Only files are read, and both sides always
//! show a certificate: settings that say otherwise are refused.

use std::sync::Arc;
use std::time::Duration;

use rustls::crypto::CryptoProvider;
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use rustls::server::WebPkiClientVerifier;
use rustls::server::danger::ClientCertVerifier;
use rustls::sign::{CertifiedKey, SingleCertAndKey};
use rustls::version::TLS13;
use rustls::{RootCertStore, ServerConfig};
use zenoh_config::Config as ZenohConfig;
use zenoh_link_commons::ConfigurationInspector;
use zenoh_protocol::core::endpoint::Config;
use zenoh_protocol::core::parameters;
use zenoh_result::{ZResult, bail, zerror};

use crate::certificate::{Admitted, Claim, Listening};

const CA: &str = "root_ca_certificate_file";
const CERTIFICATE: &str = "listen_certificate_file";
const KEY: &str = "listen_private_key_file";
const SEND_BUFFER: &str = "so_sndbuf";
/// Of an endpoint: common names of those that are let in, `|` between them. Absent: whoever has a good certificate.
pub const ADMITTED: &str = "admitted";
const HANDSHAKE_MS: &str = "tls_handshake_timeout_ms";
/// A handshake may take so long where the endpoint does not say, ms. Chosen by eye.
const DEFAULT_HANDSHAKE_MS: u64 = 5000;

/// Turns Zenoh's settings into an endpoint's.
#[derive(Clone, Copy, Debug, Default)]
pub struct TlsConfigurator;

impl ConfigurationInspector<ZenohConfig> for TlsConfigurator {
    fn inspect_config(&self, config: &ZenohConfig) -> ZResult<String> {
        let tls = config.transport().link().tls();
        let Some(ca) = tls.root_ca_certificate() else { return Ok(String::new()) };
        if !tls.enable_mtls().unwrap_or(false) {
            bail!("transport/link/tls: enable_mtls must be true");
        }
        let buffer = tls.so_sndbuf().map(|bytes| bytes.to_string());
        let named = [
            (CA, Some(ca.as_str())),
            (CERTIFICATE, tls.listen_certificate().as_deref()),
            (KEY, tls.listen_private_key().as_deref()),
            (SEND_BUFFER, buffer.as_deref()),
        ];
        Ok(parameters::from_iter(named.into_iter().filter_map(|(name, value)| value.map(|value| (name, value)))))
    }
}

/// What a listener needs.
pub(crate) struct Settings {
    pub(crate) identity: Identity,
    /// A handshake takes so long at most.
    pub(crate) handshake: Duration,
    /// `SO_SNDBUF`, bytes.
    pub(crate) send_buffer: Option<u32>,
}

/// What this side shows, and whom it lets in.
#[derive(Clone)]
pub(crate) struct Identity {
    provider: Arc<CryptoProvider>,
    clients: Arc<dyn ClientCertVerifier>,
    shown: Arc<SingleCertAndKey>,
    admitted: Admitted,
}

impl Identity {
    /// For one connection; who it says that it is, known before that is verified, goes to `claim`.
    pub(crate) fn server(&self, claim: &Claim) -> ZResult<Arc<ServerConfig>> {
        let clients = Listening::new(Arc::clone(&self.clients), claim.clone(), self.admitted.clone());
        let mut server = ServerConfig::builder_with_provider(Arc::clone(&self.provider))
            .with_protocol_versions(&[&TLS13])
            .map_err(|e| zerror!("{e}"))?
            .with_client_cert_verifier(Arc::new(clients))
            .with_cert_resolver(Arc::clone(&self.shown) as _);
        // A resumed session would not show its certificate again, which may have been revoked since.
        server.session_storage = Arc::new(rustls::server::NoServerSessionStorage {});
        server.send_tls13_tickets = 0;
        Ok(Arc::new(server))
    }
}

/// Reads an endpoint's settings and the files that they name.
pub(crate) fn read(config: &Config<'_>) -> ZResult<Settings> {
    let file = |name: &str| config.get(name).ok_or_else(|| zerror!("tls/ needs {name}"));
    let bad = |name: &str, why: &dyn std::fmt::Display| zerror!("{}: {why}", config.get(name).unwrap_or(name));
    let mut roots = RootCertStore::empty();
    for root in CertificateDer::pem_file_iter(file(CA)?).map_err(|e| bad(CA, &e))? {
        roots.add(root.map_err(|e| bad(CA, &e))?).map_err(|e| bad(CA, &e))?;
    }
    let chain: Result<Vec<_>, _> =
        CertificateDer::pem_file_iter(file(CERTIFICATE)?).map_err(|e| bad(CERTIFICATE, &e))?.collect();
    let chain = chain.map_err(|e| bad(CERTIFICATE, &e))?;
    let key = PrivateKeyDer::from_pem_file(file(KEY)?).map_err(|e| bad(KEY, &e))?;

    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let clients = WebPkiClientVerifier::builder_with_provider(Arc::new(roots), Arc::clone(&provider));
    let clients = clients.build().map_err(|e| bad(CA, &e))?;
    let shown = CertifiedKey::from_der(chain, key, &provider).map_err(|e| bad(KEY, &e))?;
    let admitted =
        config.get(ADMITTED).map(|names| names.split('|').filter(|name| !name.is_empty()).map(str::to_owned).collect());
    let identity = Identity { provider, clients, shown: Arc::new(SingleCertAndKey::from(shown)), admitted };
    identity.server(&Claim::default())?;
    Ok(Settings {
        identity,
        handshake: Duration::from_millis(number(config, HANDSHAKE_MS)?.unwrap_or(DEFAULT_HANDSHAKE_MS)),
        send_buffer: number(config, SEND_BUFFER)?,
    })
}

fn number<T: std::str::FromStr>(config: &Config<'_>, name: &str) -> ZResult<Option<T>> {
    let parse = |text: &str| text.parse().map_err(|_| zerror!("{name} is {text:?}: it must be a number").into());
    config.get(name).map(parse).transpose()
}
