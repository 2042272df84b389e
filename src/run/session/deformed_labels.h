#pragma once

#include <array>
#include <memory>
#include <mutex>

#include "palpate/device/telemetry.h"
#include "palpate/server/viewer_host.h"
#include "palpate/volume/bricks.h"

namespace palpate {

/// Label map deformed by soft tissue, as viewers see it, for volume pictures rendered by this process.
/// Versions share unchanged bricks. Thread-safe; concurrent callers wait.
class DeformedLabels {
 public:
  /// @returns ViewerHost::visible_labels(), from the host's labels and deformation
  std::shared_ptr<const Bricks<LabelId>> of(const ViewerHost& host);

 private:
  using Deformations = std::array<std::shared_ptr<const ViewedDeformation>, kMaxDevices>;
  std::mutex mutex_;
  std::shared_ptr<const Bricks<LabelId>> labels_, displayed_;
  Deformations deformations_;
};

}  // namespace palpate
