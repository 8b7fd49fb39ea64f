//! What runs the network: the processor, or an accelerator that the ONNX Runtime library in use was built for.

use ort::ep::{self, ExecutionProviderDispatch};
use schemars::JsonSchema;
use serde::Deserialize;

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

    /// What a session is to be given; none: nothing, the processor is what every session ends with.
    pub(crate) fn dispatch(self) -> Option<ExecutionProviderDispatch> {
        let provider = match self {
            Provider::Cpu => return None,
            Provider::TensorRt => ep::TensorRT::default().build(),
            Provider::Cuda => ep::CUDA::default().build(),
            Provider::OpenVino => ep::OpenVINO::default().build(),
        };
        Some(provider.error_on_failure())
    }
}
