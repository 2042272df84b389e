#include "session/tissue_thread.h"

#include <sys/resource.h>
#include <unistd.h>

#include <chrono>
#include <new>
#include <utility>

#include "palpate/palpation/logged_loop.h"
#include "palpate/servo/realtime.h"

namespace palpate {
namespace {

using Clock = std::chrono::steady_clock;
// nice value: below the ticking threads, above carving and field generation
constexpr int kPriority = 5;

/// Samples a field for display.
/// @param times  factor by which `unit_mm` is scaled
std::shared_ptr<ViewedDeformation> viewed_field(const ElasticBox& box, const ElasticLayout& layout,
                                                const ElasticField& unit_mm, double times) {
  // every second node suffices, since the displacement is smooth
  constexpr int kEvery = 2;
  auto viewed = std::make_shared<ViewedDeformation>();
  for (std::size_t axis = 0; axis < 3; ++axis) {
    viewed->nodes[axis] = box.cells[axis] / kEvery + 1;
    viewed->first_patient_mm[axis] = box.corner[static_cast<int>(axis)];
    for (std::size_t row = 0; row < 3; ++row)
      viewed->axes[3 * row + axis] =
          box.axes(static_cast<Eigen::Index>(row), static_cast<Eigen::Index>(axis));
  }
  viewed->spacing_mm = kEvery * box.cell_mm;
  viewed->moved_mm.reserve(3 * static_cast<std::size_t>(viewed->nodes[0]) * viewed->nodes[1] *
                           viewed->nodes[2]);
  for (int k = 0; k < viewed->nodes[2]; ++k)
    for (int j = 0; j < viewed->nodes[1]; ++j)
      for (int i = 0; i < viewed->nodes[0]; ++i) {
        Eigen::Vector3d unit;
        for (int c = 0; c < 3; ++c)
          unit[c] = unit_mm.values[layout.node(kEvery * i, kEvery * j, kEvery * k, c)];
        const Eigen::Vector3d moved = box.axes * unit * times;
        for (int c = 0; c < 3; ++c) viewed->moved_mm.push_back(static_cast<float>(moved[c]));
      }
  return viewed;
}

}  // namespace

std::shared_ptr<const ViewedDeformation> viewed_deformation(const SoftTissueSolver& solver,
                                                            const TickRecord& tick, std::size_t device) {
  UnitDisplacementField field;
  if (device >= static_cast<std::size_t>(tick.devices) || tick.device[device].contact_label[0] == 0 ||
      !solver.field_of(device, field))
    return nullptr;
  auto viewed = viewed_field(*field.box, *field.layout, *field.unit_mm,
                             solver.displacing_force_N(device, tick.device[device]));
  viewed->frame = solver.frame().number;
  return viewed;
}

void solve_tissue_frame(SoftTissueSolver& solver, const Model& model, const TickRecord& tick) {
  solver.solve(model, tick);
}

TissueThread::TissueThread(ServoLoop& loop, EventLog& log,
                           std::function<std::shared_ptr<const Model>()> model, Solve solve)
    : loop_(loop), log_(log), model_(std::move(model)), solve_(std::move(solve)), thread_([this] {
        run();
      }) {}

TissueThread::~TissueThread() {
  {
    const std::lock_guard lock(mutex_);
    ending_ = true;
  }
  ends_.notify_one();
  thread_.join();
}

void TissueThread::run() {
  setpriority(PRIO_PROCESS, static_cast<id_t>(gettid()), kPriority);
  constexpr auto kFrame =
      std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(kSolverFrame_s));
  CpuExclusion cpus;
  Clock::time_point next = Clock::now();
  for (bool ending = false; !ending;) {
    // avoid the servo's CPU: a tick that has to preempt a solution is later than one that finds the CPU idle
    cpus.exclude(loop_.cpu());
    Clock::duration wait = kFrame;
    try {
      solve_next();
    } catch (const std::bad_alloc&) {
      start_afresh();
      wait = kRetry;
    }
    next = std::max(next + wait, Clock::now());
    std::unique_lock lock(mutex_);
    ending = ends_.wait_until(lock, next, [this] { return ending_; });
  }
}

// Members that the exception interrupted are in no particular state.
void TissueThread::start_afresh() noexcept {
  if (!is_out_of_memory_.exchange(true)) ++failures_;
  mail_.emplace();
  if (solver_.frame().number != published_) solver_.restart(solver_.frame().number);
  rest();
  try {
    publish_unsolved();
  } catch (const std::bad_alloc&) {
    // published with the next attempt
  }
}

// passes the frame that could not be solved to the loop, if there is one
void TissueThread::publish_unsolved() {
  if (solver_.frame().number == published_) return;
  set_unsolved_logged(loop_, log_, solver_.frame(), last_input_);
  published_ = solver_.frame().number;
}

void TissueThread::solve_next() {
  publish_unsolved();
  const TickRecord tick = loop_.snapshot();
  // no tick since the last one
  if (tick.state_hash == 0 || (any_ && tick.tick <= last_input_)) return;
  // a replay solves with the model of the tick
  const std::shared_ptr<const Model> model = model_();
  if (model->version != tick.model_version) return;
  any_ = true;
  last_input_ = tick.tick;
  if (!is_moving(model->tissue_law)) {
    rest();
  } else if (model->tissue_law == TissueLaw::kChainMail) {
    move_mail(*model, tick);
  } else {
    solve_(solver_, *model, tick);
    set_solution_logged(loop_, log_, solver_.frame(), tick.tick);
    published_ = solver_.frame().number;
    show(tick);
  }
  is_out_of_memory_ = false;
}

// chain mail does not affect the force, so no input tick is recorded
void TissueThread::move_mail(const Model& model, const TickRecord& tick) {
  mail_->advance(model, tick);
  ++mail_frame_;
  for (std::size_t d = 0; d < kMaxDevices; ++d) {
    const ChainMail* const mail = mail_->of(d);
    std::shared_ptr<ViewedDeformation> viewed;
    if (mail != nullptr) {
      viewed = viewed_field(mail->box(), mail->layout(), mail->displacement_mm(), 1);
      viewed->frame = mail_frame_;
    }
    const std::lock_guard lock(mutex_);
    shown_[d] = std::move(viewed);
  }
}

void TissueThread::rest() {
  const std::lock_guard lock(mutex_);
  shown_ = {};
}

void TissueThread::show(const TickRecord& tick) {
  for (std::size_t d = 0; d < kMaxDevices; ++d) {
    auto viewed = viewed_deformation(solver_, tick, d);
    const std::lock_guard lock(mutex_);
    shown_[d] = std::move(viewed);
  }
}

std::shared_ptr<const ViewedDeformation> TissueThread::deformation(std::size_t device) const {
  const std::lock_guard lock(mutex_);
  return shown_[device];
}

}  // namespace palpate
