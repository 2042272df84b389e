#pragma once

#include <optional>
#include <vector>

#include "palpate/device/telemetry.h"
#include "palpate/server/viewed_training.h"
#include "palpate/server/viewer_host.h"
#include "server/redacted_region.h"

namespace palpate::server {

/// Progress of a run's steps in the redacted scene, from the contact with the visible structures and the
/// total force. Steps that touch a region or visit a ball are tracked; steps that cover or remove are not
/// done before the run is over. The score uses the original structures, so its steps may differ.
class RedactedSteps {
 public:
  /// @param scene  redacted scene; outlives this object
  explicit RedactedSteps(const ViewedScene& scene) : scene_(scene) {}

  /// Restarts all steps if the run has changed.
  void follow(const ViewedTraining& training);
  /// @param tick  redacted tick
  void observe(const TickRecord& tick);

  std::vector<bool> done() const;
  std::vector<double> fraction() const;

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
