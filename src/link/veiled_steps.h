#pragma once

#include <optional>
#include <vector>

#include "link/veiled_region.h"
#include "palpate/device/telemetry.h"
#include "palpate/link/viewed_training.h"
#include "palpate/link/viewer_server.h"

namespace palpate::link {

/// How far the steps of a run are as the veiled scene has them: by where the tool touches what is shown, and
/// by the total force. Steps that touch a region or visit a ball are followed; those that cover or remove are
/// not done before the run is over. A score is of the structures as they are, and may have another step done.
class VeiledSteps {
 public:
  /// @param scene  a veiled one; outlives this
  explicit VeiledSteps(const ViewedScene& scene) : scene_(scene) {}

  /// Of another run all steps begin anew.
  void follow(const ViewedTraining& training);
  /// @param tick  a veiled one
  void see(const TickRecord& tick);

  std::vector<bool> done() const;
  std::vector<double> share() const;

 private:
  struct Step {
    ViewedTask::Step asked;
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

}  // namespace palpate::link
