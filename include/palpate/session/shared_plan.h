#pragma once

#include <cstdint>
#include <deque>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "palpate/haptics/haptics.h"
#include "palpate/link/viewed_plan.h"
#include "palpate/scene/plan_file.h"

namespace palpate {

/// A plan that viewers see while it is rehearsed, and change. What they make of it is read as its file would
/// be, and refused where that is; it stays in memory until it is saved. Any thread.
class SharedPlan {
 public:
  /// @param may_change  viewers may; then the file may be missing yet: the plan is empty, and saving makes it
  /// Errors: those of load_plan, look_up_plan; kOutput for a missing file that could not be written either.
  static Result<std::shared_ptr<SharedPlan>> open(const std::filesystem::path& file, const Model& model,
                                                  bool may_change);

  /// So many versions can be gone back to.
  static constexpr std::size_t kMostBefore = 200;

  /// Never null; another object after each change.
  std::shared_ptr<const ViewedPlan> viewed() const;
  /// Errors: kUsage for another version than the one that holds, one to go back to that is not kept, a
  /// trajectory that is not there or that a region lies on, and where viewers may change nothing; kBadInput
  /// for what a plan cannot be (parse_plan); of saving kUsage where the file is not what it was when it was
  /// read or saved last, and those of write_file.
  Result<void> change(const PlanRequest& request);

 private:
  SharedPlan(std::filesystem::path file, std::optional<std::string> in_file, PlanFile plan,
             std::vector<ViewedPlan::KeepAway> keep_away, bool may_change);
  void show();
  Result<PlanFile> as_it_was(std::uint32_t version) const;
  Result<void> save();

  const std::filesystem::path file_;
  const std::vector<ViewedPlan::KeepAway> keep_away_;
  const bool may_change_;
  mutable std::mutex mutex_;            // of what follows
  std::optional<std::string> in_file_;  ///< what the file is known to hold; empty: there is none
  std::string saved_;                   ///< the plan that it holds, as plan_text has it
  PlanFile plan_;
  std::deque<std::pair<std::uint32_t, PlanFile>> before_;  ///< by ViewedPlan::version, the last kMostBefore
  std::shared_ptr<const ViewedPlan> viewed_;
};

}  // namespace palpate
