#pragma once
#include "absl/status/status.h"
#include "server/render/renderer.h"
namespace candela {
absl::Status self_test(Renderer& renderer);
}
