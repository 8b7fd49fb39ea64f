//! What runs the network: the processor, or an accelerator that the ONNX Runtime library in use was built for.

use ort::ep::{self, ArbitrarilyConfigurableExecutionProvider, ExecutionProviderDispatch};
use schemars::JsonSchema;
use serde::Deserialize;

/// How OpenVINO calculates, in its own form, for each kind of device: in how many bits; and on whatever processor the
/// system gives. Left alone it moves each thread that asks to the first processor, where all of them wait for each other.
const OPENVINO_FULL: &str = r#"{"CPU": {"INFERENCE_PRECISION_HINT": "f32", "ENABLE_CPU_PINNING": "NO"},
    "GPU": {"INFERENCE_PRECISION_HINT": "f32"}}"#;
/// The same, in half as many bits.
const OPENVINO_HALF: &str = r#"{"CPU": {"INFERENCE_PRECISION_HINT": "bf16", "ENABLE_CPU_PINNING": "NO"},
    "GPU": {"INFERENCE_PRECISION_HINT": "f16"}}"#;

/// One of ONNX Runtime's execution providers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Provider {
    /// The processor; always there.
    #[default]
    Cpu,
    /// NVIDIA, by TensorRT: the fastest on a Jetson; building the engine takes a minute at the first start.
    TensorRt,
    /// NVIDIA, by CUDA.
    Cuda,
    /// Intel processors and their graphics, by OpenVINO.
    OpenVino,
}

impl Provider {
    /// Its name, as the vehicle file spells it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Provider::Cpu => "cpu",
            Provider::TensorRt => "tensorrt",
            Provider::Cuda => "cuda",
            Provider::OpenVino => "openvino",
        }
    }

    /// Whether it can calculate in 16 bits.
    pub(crate) fn has_half(self) -> bool {
        matches!(self, Provider::TensorRt | Provider::OpenVino)
    }

    /// What a session is to be given; none: nothing, the processor is what every session ends with. `half`: in 16 bits
    /// where it can. `threads` are those of the processor.
    pub(crate) fn dispatch(self, half: bool, threads: usize) -> Option<ExecutionProviderDispatch> {
        let provider = match self {
            Provider::Cpu => return None,
            Provider::TensorRt => ep::TensorRT::default().with_fp16(half).build(),
            Provider::Cuda => ep::CUDA::default().build(),
            Provider::OpenVino => ep::OpenVINO::default()
                .with_num_threads(threads.max(1))
                .with_arbitrary_config("load_config", if half { OPENVINO_HALF } else { OPENVINO_FULL })
                .build(),
        };
        Some(provider.error_on_failure())
    }
}
