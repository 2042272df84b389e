#include "session/law_choice.h"

#include <exception>
#include <new>
#include <utility>

#include "palpate/base/reason.h"
#include "palpate/scene/named_values.h"

namespace palpate {
namespace {

Error unsolved(TissueLaw law) {
  return {ErrorKind::kUnavailable,
          std::string("memory ran out while soft tissue was solved: ") +
              (is_elastic(law) ? "its force is that of a homogeneous half-space, and it is shown undeformed"
                               : "it is shown undeformed"),
          std::string(name_of(law, kTissueLaws)),
          "close other programs to free memory; the solver starts again every second"};
}

}  // namespace

LawChoice::LawChoice(LiveModel& model, SessionLoop& loop, std::size_t devices, Prepare prepare,
                     TissueFrames::Solve solve, Wake wake, const std::string& coarser_tissue)
    : model_(model),
      loop_(loop),
      devices_(devices),
      prepare_(std::move(prepare)),
      solve_(std::move(solve)),
      wake_(std::move(wake)) {
  const Model& current = model_.current(model_.lock());
  if (is_elastic(current.tissue_law))
    cell_size_of(current.tissue_law) = {current.tissue_cell_factor, coarser_tissue};
}

void LawChoice::begin(bool threads) {
  const LiveModel::Lock lock = model_.lock();
  has_threads_ = threads;
  if (is_moving(model_.current(lock).tissue_law)) start_solver(lock);
}

void LawChoice::end() {
  std::unique_ptr<TissueFrames> solver;
  std::unique_ptr<TissueThread> thread;  // ends before its solver, and without the lock
  {
    const LiveModel::Lock lock = model_.lock();
    has_ended_ = true;
    solver_for_readers_.store(nullptr);
    solver = std::move(solver_);
    thread = std::move(solver_thread_);
    if (solver != nullptr && solver->failures() > 0)
      later_warnings_.push_back(
          "memory ran out while soft tissue was solved" +
          (solver->failures() > 1 ? " (" + std::to_string(solver->failures()) + " times)" : std::string()) +
          ": its force was that of a homogeneous half-space meanwhile");
  }
}

// the thread keeps running, idle, when a law without moving tissue is selected later
void LawChoice::start_solver(const LiveModel::Lock& lock) {
  if (solver_ != nullptr || has_ended_ || !model_.current(lock).has(ForceMethod::kProxy)) return;
  solver_ = std::make_unique<TissueFrames>(
      *loop_.get(), loop_.log(), [this] { return model_.versions(model_.lock()).current; }, solve_);
  solver_for_readers_.store(solver_.get());
  if (has_threads_) solver_thread_ = std::make_unique<TissueThread>(*loop_.get(), *solver_);
}

bool LawChoice::run_step(TissueFrames::Clock::time_point now) {
  TissueFrames* solver = nullptr;
  {
    const LiveModel::Lock lock = model_.lock();
    if (solver_thread_ == nullptr) solver = solver_.get();
  }
  // the step locks the model itself
  if (solver == nullptr || solver->due() > now) return false;
  solver->run_step(now);
  return solver->due() <= now;
}

// takes effect immediately unless surfaces have to be built or the solver's cell size has to be measured
Result<void> LawChoice::choose(const LiveModel::Lock& lock, TissueLaw law, RequestedBy by) {
  const Model& model = model_.current(lock);
  failure_.reset();
  if (law == model.tissue_law) {
    awaited_.reset();
    script_version_ = model.version;
    return {};
  }
  if (auto fine = check_law(model, law); !fine) return fine.error();
  const bool is_measured = !is_elastic(law) || cell_size_of(law).cell_factor > 0;
  if (!has_other_surfaces(model, law) && is_measured) {
    auto under = under_law(model, law);
    if (!under) return under.error();
    switch_to(lock, **under, is_elastic(law) ? cell_size_of(law).cell_factor : 0, by);
    return {};
  }
  if (auto woken = wake_(lock); !woken) return woken;
  awaited_ = law;
  awaited_by_ = by;
  return {};
}

// switches the current model version to the law of `under`
void LawChoice::switch_to(const LiveModel::Lock& lock, const Model& under, double cell_factor,
                          RequestedBy by) {
  const ModelVersions& now = model_.versions(lock);
  const ModelChange change = change_of_law(*now.current, under.tissue_law, cell_factor);
  if (is_moving(under.tissue_law)) start_solver(lock);
  model_.apply(lock, {with_law(*now.current, under, change), now.prepared}, change, by);
  awaited_.reset();
  script_version_ = change.version;
}

void LawChoice::choose_by_script(TissueLaw law) {
  const bool runs = loop_.get() != nullptr;
  const LiveModel::Lock lock = model_.lock();
  script_version_.reset();
  // a law that the script may not use was rejected when the script was read; a viewer may have cut since
  if (!runs || !choose(lock, law, {Originator::kScript})) script_version_ = 0;
}

std::optional<std::uint32_t> LawChoice::script_version() const {
  const LiveModel::Lock lock = model_.lock();
  return script_version_;
}

void LawChoice::prepare(LiveModel::Lock& lock, const Progress& progress) {
  const std::shared_ptr<const Model> current = model_.versions(lock).current;
  const TissueLaw law = *awaited_;
  // unlock: a thread waiting for the lock would inherit this thread's low priority as latency
  lock.unlock();
  const auto made = [&]() -> Result<MeasuredCells> {
    try {
      return prepare_(*current, law, devices_, progress);
    } catch (const std::exception& why) {
      return Error{ErrorKind::kUnavailable,
                   std::string("the surfaces of soft tissue could not be prepared: ") + reason_of(why), "",
                   "continue with this law, or close other programs to free memory"};
    }
  }();
  lock.lock();
  // the request may have been replaced or withdrawn; surfaces built for an older model version do not fit
  if (progress.stopped() || awaited_ != law || model_.versions(lock).current != current) return;
  if (!made) return abandon(lock, made.error());
  const double cell_factor = is_elastic(law) ? made->model->tissue_cell_factor : 0;
  switch_to(lock, *made->model, cell_factor, awaited_by_);
  if (!is_elastic(law)) return;
  if (cell_size_of(law).cell_factor == 0 && !made->warning.empty()) later_warnings_.push_back(made->warning);
  cell_size_of(law) = {cell_factor, made->warning};
}

// keeps the current law and reports the error to the requester
void LawChoice::abandon(const LiveModel::Lock& /*held*/, Error why) {
  why.where = name_of(*awaited_, kTissueLaws);
  awaited_.reset();
  failure_ = std::move(why);
  script_version_ = 0;
}

void LawChoice::abandon_without_memory(const LiveModel::Lock& /*held*/) noexcept {
  if (!awaited_) return;
  script_version_ = 0;
  try {
    failure_.emplace(Error{ErrorKind::kUnavailable, "out of memory", "", ""}).where =
        name_of(*awaited_, kTissueLaws);
  } catch (const std::bad_alloc&) {
    // the request ends without a reason
  }
  awaited_.reset();
}

void LawChoice::describe(const LiveModel::Lock& lock, ViewedState& state) const {
  const Model& model = model_.current(lock);
  state.law = name_of(model.tissue_law, kTissueLaws);
  if (is_elastic(model.tissue_law)) {
    state.law_cell_mm = solver_cell_mm(model);
    state.requested_cell_mm = state.law_cell_mm / model.tissue_cell_factor;
  }
  if (awaited_) state.law_awaited = name_of(*awaited_, kTissueLaws);
  state.law_failure = failure_;
  if (!failure_ && solver_ != nullptr && solver_->is_out_of_memory())
    state.law_failure = unsolved(model.tissue_law);
}

std::string LawChoice::coarser_tissue() const {
  const LiveModel::Lock lock = model_.lock();
  return cell_size_of(model_.current(lock).tissue_law).warning;
}

std::vector<std::string> LawChoice::later_warnings() const {
  const LiveModel::Lock lock = model_.lock();
  return later_warnings_;
}

std::shared_ptr<const ViewedDeformation> LawChoice::deformation(std::size_t device) const {
  const TissueFrames* const solver = solver_for_readers_.load();
  return solver != nullptr ? solver->deformation(device) : nullptr;
}

}  // namespace palpate
