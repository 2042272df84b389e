#pragma once

#include <optional>
#include <vector>

#include "palpate/device/telemetry.h"
#include "palpate/server/viewed_training.h"
#include "palpate/server/viewer_server.h"
#include "server/veiled_region.h"

namespace palpate::server {

/// Progress of a run's steps in the veiled scene, from the contact with the visible structures and the total
/// force. Steps that touch a region or visit a ball are tracked; steps that cover or remove are not done
/// before the run is over. The score uses the original structures, so its steps may differ.
class VeiledSteps {
 public:
  /// @param scene  veiled scene; outlives this object
  explicit VeiledSteps(const ViewedScene& scene) : scene_(scene) {}

  /// Restarts all steps if the run has changed.
  void follow(const ViewedTraining& training);
  /// @param tick  veiled tick
  void observe(const TickRecord& tick);

  std::vector<bool> done() const;
  std::vector<double> share() const;

 private:
  struct Step {
    ViewedTask::Step requested;
    std::optional<RegionExtent> region;
    double met_s = 0;
    bool was_met = false, done = false;
  };
  bool is_met(const Step& step, const TickRecord& tick) const;

  const ViewedScene& scene_;
  std::uint32_t run_ = 0;
  bool is_running_ = false, ordered_ = false;
  double last_s_ = 0;
  std::vector<Step> steps_;
};

}  // namespace palpate::server
