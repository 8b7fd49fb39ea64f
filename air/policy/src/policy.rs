//! A loaded policy: the ONNX session, its contract, and the call that runs it.

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use goshawk_core::{ANCHORS, MAX_CHANNELS, NetworkOutput};
use ort::environment::Environment;
use ort::ep::ExecutionProviderDispatch;
use ort::session::{HasSelectedOutputs, OutputSelector, RunOptions, Session, SessionInputValue};
use ort::value::{Outlet, Tensor, TensorElementType, TensorRef, ValueType};
use sha2::{Digest, Sha256};

use crate::contract::{COLUMNS, Contract, ContractError, METADATA_KEY, ROWS};
use crate::library::{self, LibraryError, Places};
use crate::provider::Provider;

const RGBD: &str = "rgbd";
const STATE: &str = "state";
const PREDICTION: &str = "prediction";

/// Why a policy cannot be loaded or run.
#[derive(Debug, thiserror::Error)]
pub enum PolicyError {
    /// The file cannot be read.
    #[error("policy {} cannot be read ({source}): is the path in the vehicle file, or in --policy, right?", path.display())]
    Read {
        /// The policy's file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// There is no ONNX Runtime library.
    #[error(transparent)]
    Library(#[from] LibraryError),
    /// The library that was found does not load.
    #[error("ONNX Runtime library {}: {message}", path.display())]
    LibraryLoad {
        /// The library's file.
        path: PathBuf,
        /// Why.
        message: String,
    },
    /// One process can hold one ONNX Runtime, and it holds another.
    #[error("ONNX Runtime is already loaded from {}, so {} cannot be", loaded.display(), asked.display())]
    AnotherLibrary {
        /// The one in use.
        loaded: PathBuf,
        /// The configured one.
        asked: PathBuf,
    },
    /// Another file than the vehicle file pins.
    #[error(
        "policy {} has the SHA-256 {found}, the vehicle file pins {pinned}: put the pinned file there, or, if this one \
         is to be flown, write its hash (its card has it too) into policy.sha256",
        path.display()
    )]
    Pin {
        /// The policy's file.
        path: PathBuf,
        /// Its own.
        found: String,
        /// The vehicle file's.
        pinned: String,
    },
    /// The file is not a model that ONNX Runtime can run.
    #[error("policy {}: not a runnable ONNX model: {source}", path.display())]
    NotOnnx {
        /// The policy's file.
        path: PathBuf,
        /// Why.
        source: ort::Error,
    },
    /// An ONNX model that was not exported as a policy.
    #[error("policy {}: no contract in its metadata (key {METADATA_KEY}): export it with `goshawk train export`", path.display())]
    NoContract {
        /// The policy's file.
        path: PathBuf,
    },
    /// The contract cannot be honoured.
    #[error("policy {}: {source}", path.display())]
    Contract {
        /// The policy's file.
        path: PathBuf,
        /// What differs.
        source: ContractError,
    },
    /// The model's inputs or outputs are not what its contract says.
    #[error("policy {}: the model has {found}, its contract needs {needed}", path.display())]
    Shape {
        /// The policy's file.
        path: PathBuf,
        /// The model's inputs or outputs.
        found: String,
        /// Those of the contract.
        needed: String,
    },
    /// The provider that was asked for is not to be had, where no other will do.
    #[error(
        "the network does not run on {asked}: {why}; name a library that was built for it in policy.library of the \
         vehicle file, or set policy.provider = \"cpu\""
    )]
    Provider {
        /// Its name.
        asked: &'static str,
        /// In one line.
        why: String,
    },
    /// The caller's input has the wrong length.
    #[error("input {input} has {found} numbers, the policy needs {needed}")]
    Length {
        /// "rgbd" or "state".
        input: &'static str,
        /// Numbers given.
        found: usize,
        /// Numbers needed.
        needed: usize,
    },
    /// ONNX Runtime failed while running.
    #[error("inference failed: {0}")]
    Inference(#[from] ort::Error),
}

/// ONNX Runtime's environment. The library is loaded once for a process and never unloaded; `ort` allows one
/// environment ever, so it is kept here rather than passed about. It holds no setting that a caller could change.
static RUNTIME: Mutex<Option<(PathBuf, Environment)>> = Mutex::new(None);

fn environment(configured: Option<&Path>) -> Result<Environment, PolicyError> {
    let mut runtime = RUNTIME.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((loaded, environment)) = runtime.as_ref() {
        return match configured {
            Some(_) => {
                let asked = library::find(configured, &Places::default())?;
                let same = asked.canonicalize().ok() == loaded.canonicalize().ok();
                if same {
                    Ok(environment.clone())
                } else {
                    Err(PolicyError::AnotherLibrary { loaded: loaded.clone(), asked })
                }
            }
            None => Ok(environment.clone()),
        };
    }
    let path = library::find(configured, &Places::of_process())?;
    let path = path.canonicalize().unwrap_or(path);
    let failed = |message: String| PolicyError::LibraryLoad { path: path.clone(), message };
    let builder = ort::init_from(&path).map_err(|error| failed(error.to_string()))?;
    let builder = builder.with_name("goshawk").with_telemetry(false);
    let environment = builder.build().map_err(|error| failed(error.to_string()))?;
    *runtime = Some((path, environment.clone()));
    Ok(environment)
}

/// The model of `bytes` on `provider`; none: on the processor.
fn session(
    environment: &Environment,
    threads: usize,
    provider: Option<ExecutionProviderDispatch>,
    bytes: &[u8],
) -> ort::Result<Session> {
    let builder = Session::builder(environment)?.with_intra_threads(threads.max(1))?.with_inter_threads(1)?;
    let mut builder = match provider {
        Some(provider) => builder.with_execution_providers([provider])?,
        None => builder,
    };
    builder.commit_from_memory(bytes)
}

/// A policy that is ready to fly.
pub struct Policy {
    contract: Contract,
    contract_json: String,
    sha256: String,
    session: Session,
    /// Writes into the same tensor each time.
    options: RunOptions<HasSelectedOutputs>,
    /// The model takes `rgbd` before `state`.
    rgbd_first: bool,
    provider: Provider,
    half: bool,
    why_not: Option<String>,
}

impl Policy {
    /// [`Self::load_on`] the processor.
    ///
    /// # Errors
    /// As there.
    pub fn load(path: &Path, library: Option<&Path>, threads: usize) -> Result<Self, PolicyError> {
        Self::load_on(Provider::Cpu, false, path, library, threads)
    }

    /// Loads an exported ONNX file and checks it against its contract.
    ///
    /// A `provider` that cannot run it here is replaced by the processor: [`Self::provider`], [`Self::why_not`].
    /// `half`: in 16 bits where the provider can, which the processor cannot.
    /// `library`: ONNX Runtime's file or directory; absent: the usual places ([`library::find`]). `threads`: threads of
    /// one inference, the caller's included (at least 1).
    ///
    /// # Errors
    /// Whatever is wrong with the file, the library or the contract, each its own variant.
    pub fn load_on(
        provider: Provider,
        half: bool,
        path: &Path,
        library: Option<&Path>,
        threads: usize,
    ) -> Result<Self, PolicyError> {
        let bytes = std::fs::read(path).map_err(|source| PolicyError::Read { path: path.into(), source })?;
        let not_onnx = |source: ort::Error| PolicyError::NotOnnx { path: path.into(), source };
        let environment = environment(library)?;
        let asked = provider.dispatch(half, threads);
        let accelerated = asked.map(|asked| session(&environment, threads, Some(asked), &bytes));
        let (session, provider, why_not) = match accelerated {
            Some(Ok(session)) => (session, provider, None),
            Some(Err(why)) => {
                let why = why.to_string().split_whitespace().collect::<Vec<_>>().join(" ");
                (session(&environment, threads, None, &bytes).map_err(not_onnx)?, Provider::Cpu, Some(why))
            }
            None => (session(&environment, threads, None, &bytes).map_err(not_onnx)?, Provider::Cpu, None),
        };
        let contract_json = session.metadata()?.custom(METADATA_KEY);
        let contract_json = contract_json.ok_or_else(|| PolicyError::NoContract { path: path.into() })?;
        let contract = Contract::from_json(&contract_json)
            .map_err(|source| PolicyError::Contract { path: path.into(), source })?;
        check_shapes(path, &session, &contract)?;

        let output = Tensor::<f32>::new(session.allocator(), [1, contract.channels.len(), ROWS, COLUMNS])?;
        let selector = OutputSelector::no_default().with(PREDICTION).preallocate(PREDICTION, output);
        let options = RunOptions::new()?.with_outputs(selector);
        let rgbd_first = session.inputs()[0].name() == RGBD;
        let sha256 = hex(&Sha256::digest(&bytes));
        let half = half && provider.has_half();
        Ok(Self { contract, contract_json, sha256, session, options, rgbd_first, provider, half, why_not })
    }

    /// What runs the network.
    #[must_use]
    pub fn provider(&self) -> Provider {
        self.provider
    }

    /// It is calculated in 16 bits.
    #[must_use]
    pub fn half(&self) -> bool {
        self.half
    }

    /// Why the provider that was asked for does not run it, in one line; none: it does.
    #[must_use]
    pub fn why_not(&self) -> Option<&str> {
        self.why_not.as_deref()
    }

    /// What the file says of itself.
    #[must_use]
    pub fn contract(&self) -> &Contract {
        &self.contract
    }

    /// The contract's text as the file has it.
    #[must_use]
    pub fn contract_json(&self) -> &str {
        &self.contract_json
    }

    /// SHA-256 of the file, lower-case hexadecimal.
    #[must_use]
    pub fn sha256(&self) -> &str {
        &self.sha256
    }

    /// It is the file of this hash.
    ///
    /// # Errors
    /// It is another one; `path` is what it is called.
    pub fn pinned(&self, path: &Path, sha256: &str) -> Result<(), PolicyError> {
        if self.sha256 == sha256 {
            return Ok(());
        }
        Err(PolicyError::Pin { path: path.into(), found: self.sha256.clone(), pinned: sha256.to_owned() })
    }

    /// Numbers of the `rgbd` input, `[4, height, width]`.
    #[must_use]
    pub fn rgbd_len(&self) -> usize {
        4 * self.contract.image.height * self.contract.image.width
    }

    /// Numbers of the `state` input.
    #[must_use]
    pub fn state_len(&self) -> usize {
        self.contract.state_len()
    }

    /// Runs the network on one frame; the core decodes and checks the values.
    ///
    /// `rgbd`: [`crate::Preprocessor`]'s output. `state`: what the contract lists,
    /// [`Self::state_len`] numbers. The inputs are read in place and the output's tensor is reused.
    ///
    /// # Errors
    /// An input of the wrong length, or ONNX Runtime failed.
    pub fn infer(&mut self, rgbd: &[f32], state: &[f32]) -> Result<NetworkOutput, PolicyError> {
        for (input, found, needed) in [(RGBD, rgbd.len(), self.rgbd_len()), (STATE, state.len(), self.state_len())] {
            if found != needed {
                return Err(PolicyError::Length { input, found, needed });
            }
        }
        let image = self.contract.image;
        let rgbd: SessionInputValue = TensorRef::from_array_view(([1, 4, image.height, image.width], rgbd))?.into();
        let state: SessionInputValue = TensorRef::from_array_view(([1, state.len()], state))?.into();
        let inputs = if self.rgbd_first { [rgbd, state] } else { [state, rgbd] };
        let outputs = self.session.run_with_options(inputs, &self.options)?;
        let (_, prediction) = outputs[0].try_extract_tensor::<f32>()?;
        let mut output = NetworkOutput { values: [0.0; MAX_CHANNELS * ANCHORS] };
        output.values[..prediction.len()].copy_from_slice(prediction);
        Ok(output)
    }
}

impl fmt::Debug for Policy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Policy").field("sha256", &self.sha256).field("contract", &self.contract).finish_non_exhaustive()
    }
}

/// The inputs and outputs must be those of the contract, float32 and of fixed shape; inputs in any order.
fn check_shapes(path: &Path, session: &Session, contract: &Contract) -> Result<(), PolicyError> {
    let side = |size: usize| size as i64;
    let rgbd = vec![1, 4, side(contract.image.height), side(contract.image.width)];
    let state = vec![1, side(contract.state_len())];
    let prediction = vec![1, side(contract.channels.len()), side(ROWS), side(COLUMNS)];
    let kinds = [
        ("inputs", session.inputs(), vec![(RGBD, rgbd), (STATE, state)]),
        ("outputs", session.outputs(), vec![(PREDICTION, prediction)]),
    ];
    for (kind, outlets, needed) in kinds {
        let mut found: Vec<String> = outlets.iter().map(describe).collect();
        let mut needed: Vec<String> = needed.iter().map(|(name, shape)| format!("{name} float32{shape:?}")).collect();
        found.sort();
        needed.sort();
        if found != needed {
            let text = |list: &[String]| format!("{kind} {}", list.join(", "));
            return Err(PolicyError::Shape { path: path.into(), found: text(&found), needed: text(&needed) });
        }
    }
    Ok(())
}

fn describe(outlet: &Outlet) -> String {
    match outlet.dtype() {
        ValueType::Tensor { ty: TensorElementType::Float32, shape, .. } => {
            format!("{} float32{:?}", outlet.name(), shape.to_vec())
        }
        other => format!("{} {other}", outlet.name()),
    }
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}
