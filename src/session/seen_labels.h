#pragma once

#include <array>
#include <memory>
#include <mutex>

#include "palpate/device/telemetry.h"
#include "palpate/link/viewer_server.h"
#include "palpate/volume/bricks.h"

namespace palpate {

/// Labels where soft tissue that yields is seen, as viewers are told of it, for pictures of the volume that
/// are made here. Versions share what is the same in them. Any thread; whoever comes second waits.
class SeenLabels {
 public:
  /// @returns ViewerHost::seen_labels(), by what the host says of its labels and of what has yielded
  std::shared_ptr<const Bricks<LabelId>> of(const ViewerHost& host);

 private:
  using Yields = std::array<std::shared_ptr<const ViewedYield>, kMaxDevices>;
  std::mutex mutex_;
  std::shared_ptr<const Bricks<LabelId>> labels_, seen_;
  Yields yields_;
};

}  // namespace palpate
