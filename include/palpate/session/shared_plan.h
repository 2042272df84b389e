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

#include "palpate/contact/model.h"
#include "palpate/scene/plan_file.h"
#include "palpate/server/viewed_plan.h"

namespace palpate {

/// Plan shown to viewers during a rehearsal, and edited by them. An edit is parsed by the rules of the plan
/// file and refused where the file would be. Edits stay in memory until saved. Thread-safe.
class SharedPlan {
 public:
  /// @param may_change  whether viewers may edit; if so the file need not exist: the plan is empty and saving
  ///                    creates it
  /// Errors: those of load_plan and resolve_plan; kOutput if the file is missing and cannot be created.
  static Result<std::shared_ptr<SharedPlan>> open(const std::filesystem::path& file, const Model& model,
                                                  bool may_change);

  /// Maximum number of versions stored for undo.
  static constexpr std::size_t kMaxUndoVersions = 200;

  /// Current plan; never null. Each change creates a new object.
  std::shared_ptr<const ViewedPlan> viewed() const;
  /// Errors: kUsage if the request refers to a version that is not current, to a version that is no longer
  /// stored, or to a trajectory that does not exist or that a region depends on, and if viewers may not edit;
  /// kBadInput for an invalid plan (parse_plan). When saving: kUsage if the file has been modified since it
  /// was last read or saved, and the errors of write_file.
  Result<void> change(const PlanRequest& request);

 private:
  SharedPlan(std::filesystem::path file, std::optional<std::string> in_file, PlanFile plan,
             std::vector<ViewedPlan::KeepAway> keep_away, bool may_change);
  void publish();
  Result<PlanFile> plan_at(std::uint32_t version) const;
  Result<void> save();

  const std::filesystem::path file_;
  const std::vector<ViewedPlan::KeepAway> keep_away_;
  const bool may_change_;
  mutable std::mutex mutex_;            // guards the members below
  std::optional<std::string> in_file_;  ///< Expected content of the file; empty: the file does not exist
  std::string saved_;                   ///< Text of the plan last saved, as plan_text writes it
  PlanFile plan_;
  /// Earlier plans by ViewedPlan::version; the last kMaxUndoVersions
  std::deque<std::pair<std::uint32_t, PlanFile>> earlier_plans_;
  std::shared_ptr<const ViewedPlan> viewed_;
};

}  // namespace palpate
