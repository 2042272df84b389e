#pragma once

#include <algorithm>
#include <iterator>
#include <memory>
#include <utility>
#include <vector>

#include "palpate/contact/model.h"
#include "palpate/device/sweep_record.h"
#include "palpate/tissue/carving.h"
#include "session/cut_list.h"

namespace palpate {

/// Labels of a model minus the swept volume, at one position of the recording after another; extends the
/// previous result if possible.
class CutLabels {
 public:
  std::shared_ptr<const Bricks<LabelId>> by(const Model& model, std::vector<SweepRecord> sweeps) {
    const bool continues =
        sweeps.size() >= sweeps_.size() && std::equal(sweeps_.begin(), sweeps_.end(), sweeps.begin());
    if (!continues || carving_ == nullptr) {
      carving_ = std::make_shared<const Carving>(model);
      labels_ = model.labels;
      sweeps_.clear();
    }
    if (sweeps.size() == sweeps_.size()) return labels_;
    std::vector<Cut> more;
    std::transform(sweeps.begin() + static_cast<std::ptrdiff_t>(sweeps_.size()), sweeps.end(),
                   std::back_inserter(more), cut_of);
    carving_ = carving_->with(more);
    labels_ = carving_->applied_to(model)->labels;
    sweeps_ = std::move(sweeps);
    return labels_;
  }

 private:
  std::vector<SweepRecord> sweeps_;  ///< Sweeps applied to carving_
  std::shared_ptr<const Carving> carving_;
  std::shared_ptr<const Bricks<LabelId>> labels_;
};

}  // namespace palpate
