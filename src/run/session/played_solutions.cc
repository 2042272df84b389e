#include "session/played_solutions.h"

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <limits>
#include <new>
#include <utility>
#include <vector>

#include "palpate/model/changed_model.h"
#include "palpate/tissue/displayed_law.h"
#include "session/tissue_thread.h"

namespace palpate {
namespace {

// nice value; lower priority than the thread that reads the recording
constexpr int kSolverPriority = 5;

}  // namespace

PlayedSolutions::PlayedSolutions(std::shared_ptr<const Model> model, SolutionIndex index, CutList cuts,
                                 LawHistory laws, TickAt tick_at)
    : model_(std::move(model)),
      index_(std::move(index)),
      cuts_(std::move(cuts)),
      laws_(std::move(laws)),
      tick_at_(std::move(tick_at)),
      cut_(model_) {
  thread_ = std::thread([this] { run(); });
}

PlayedSolutions::~PlayedSolutions() {
  ending_ = true;
  {
    const std::lock_guard lock(mutex_);
    changed_.notify_all();
  }
  thread_.join();
}

void PlayedSolutions::request(std::uint32_t number, std::uint32_t near) {
  const std::lock_guard lock(mutex_);
  near_ = near;
  if (wanted_ == number) return;
  wanted_ = number;
  changed_.notify_all();
}

std::shared_ptr<const ViewedDeformation> PlayedSolutions::deformation(std::size_t device) const {
  const std::lock_guard lock(mutex_);
  const std::uint32_t far = std::max(wanted_, done_) - std::min(wanted_, done_);
  return device < kMaxDevices && far <= near_ ? shown_[device] : nullptr;
}

void PlayedSolutions::run() {
  setpriority(PRIO_PROCESS, static_cast<id_t>(gettid()), kSolverPriority);
  std::unique_lock lock(mutex_);
  while (!ending_) {
    const std::uint32_t requested = wanted_;
    if (requested == done_) {
      changed_.wait(lock);
      continue;
    }
    lock.unlock();
    Shown shown;
    try {
      shown = solve(requested);
    } catch (const std::bad_alloc&) {
      // out of memory: tissue is shown at rest
    }
    lock.lock();
    shown_ = std::move(shown);
    done_ = requested;
  }
}

PlayedSolutions::Shown PlayedSolutions::solve(std::uint32_t number) {
  const Progress progress({}, &ending_);
  Shown shown;
  auto some = index_.up_to(number, kMaxGap);
  // continue from the last solution, or start a few solutions earlier
  const auto last = std::ranges::find(some, solver_.frame().number, &SolutionIndex::Solution::number);
  const bool continues = last != some.end() && last + 1 != some.end();
  some = some.last(continues ? static_cast<std::size_t>(some.end() - last) - 1
                             : std::min(some.size(), kLeadIn + 1));
  for (const SolutionIndex::Solution& solution : some) {
    const auto input_tick = tick_at_(solution.row, progress);
    const auto model = input_tick && !ending_ ? model_of(input_tick->model_version) : nullptr;
    if (model == nullptr) return shown;
    if (solver_.frame().number + 1 != solution.number)
      solver_.resume(*model, solution.number - 1, index_.boxes(solution));
    solver_.solve(*model, *input_tick);
    if (solution.number != number) continue;
    for (std::size_t d = 0; d < kMaxDevices; ++d) shown[d] = viewed_deformation(solver_, *input_tick, d);
  }
  return shown;
}

// Model with the labels and surfaces of that version, derived from the previous one if only more was cut.
// Null if the version cannot be built or the thread is ending.
std::shared_ptr<const Model> PlayedSolutions::model_of(std::uint32_t version) {
  const std::size_t by = cuts_.count_at(version);
  const std::vector<std::uint64_t>& undone_to = cuts_.undone_to(version);
  const TissueLaw law = laws_.at(version);
  const double cell_factor = laws_.cell_factor_at(version);
  const auto is_under_law = [&](const Model& model) {
    return model.tissue_law == law && model.tissue_cell_factor == cell_factor;
  };
  if (by == cut_by_ && undone_to == undone_to_ && is_under_law(*cut_)) return cut_;
  const bool continues = undone_to == undone_to_ && by > cut_by_;
  const std::shared_ptr<const Model>& from = continues ? cut_ : model_;
  std::vector<Cut> cuts;
  for (const SweepRecord& sweep :
       cuts_.sweeps_at(version, continues ? cut_by_ : 0, std::numeric_limits<std::size_t>::max()))
    cuts.push_back(cut_of(sweep));
  std::shared_ptr<const Model> made = from;
  if (!cuts.empty()) {
    ModelChange change;
    change.version = from->version + 1;
    change.tissue = ModelChange::kCut;
    auto changed = next_version({from, from}, change, cuts, Progress({}, &ending_));
    if (!changed) return nullptr;
    made = changed->current;
  }
  if (!is_under_law(*made)) {
    auto under = std::make_shared<Model>(displayed_under_law(*made, law));
    under->tissue_cell_factor = cell_factor;
    made = std::move(under);
  }
  cut_ = std::move(made);
  cut_by_ = by;
  undone_to_ = undone_to;
  return cut_;
}

}  // namespace palpate
