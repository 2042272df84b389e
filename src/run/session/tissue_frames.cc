#include "session/tissue_frames.h"

#include <algorithm>
#include <new>
#include <utility>

#include "palpate/palpation/logged_loop.h"

namespace palpate {
namespace {

/// Samples a field for display.
/// @param scale  factor by which `unit_mm` is scaled
std::shared_ptr<ViewedDeformation> viewed_field(const ElasticBox& box, const ElasticLayout& layout,
                                                const ElasticField& unit_mm, double scale) {
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
        const Eigen::Vector3d moved = box.axes * unit * scale;
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

void begin_tissue_frame(SoftTissueSolver& solver, const Model& model, const TickRecord& tick) {
  solver.begin_frame(model, tick);
}

TissueFrames::TissueFrames(ServoLoop& loop, EventLog& log,
                           std::function<std::shared_ptr<const Model>()> model, Solve solve)
    : loop_(loop), log_(log), model_(std::move(model)), solve_(std::move(solve)) {}

void TissueFrames::run_step(Clock::time_point now) {
  constexpr auto kFrame =
      std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(kSolverFrame_s));
  Clock::duration wait = kFrame;
  try {
    if (!in_progress_) {
      begun_ = due_;
      begin_frame();
    }
    if (in_progress_) {
      due_ = now;
      if (!solver_.step()) return;
      finish_frame();
    }
  } catch (const std::bad_alloc&) {
    start_afresh();
    wait = kRetry;
  }
  // frames that a slow machine misses are not made up for
  due_ = std::max(begun_ + wait, now);
}

// Members that the exception interrupted are in no particular state.
void TissueFrames::start_afresh() noexcept {
  if (!is_out_of_memory_.exchange(true)) ++failures_;
  in_progress_.reset();
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
void TissueFrames::publish_unsolved() {
  if (solver_.frame().number == published_) return;
  set_unsolved_logged(loop_, log_, solver_.frame(), last_input_);
  published_ = solver_.frame().number;
}

void TissueFrames::begin_frame() {
  publish_unsolved();
  const TickRecord tick = loop_.snapshot();
  // no tick since the last one
  if (tick.state_hash == 0 || (has_input_ && tick.tick <= last_input_)) return;
  // a replay solves with the model of the tick
  std::shared_ptr<const Model> model = model_();
  if (model->version != tick.model_version) return;
  has_input_ = true;
  last_input_ = tick.tick;
  if (!is_moving(model->tissue_law)) {
    rest();
  } else if (model->tissue_law == TissueLaw::kChainMail) {
    move_mail(*model, tick);
  } else {
    solve_(solver_, *model, tick);
    in_progress_ = Input{std::move(model), tick};
    return;
  }
  is_out_of_memory_ = false;
}

void TissueFrames::finish_frame() {
  const Input solved = *std::exchange(in_progress_, {});
  set_solution_logged(loop_, log_, solver_.frame(), solved.tick.tick);
  published_ = solver_.frame().number;
  show(solved.tick);
  is_out_of_memory_ = false;
}

// chain mail does not affect the force, so no input tick is recorded
void TissueFrames::move_mail(const Model& model, const TickRecord& tick) {
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

void TissueFrames::rest() {
  const std::lock_guard lock(mutex_);
  shown_ = {};
}

void TissueFrames::show(const TickRecord& tick) {
  for (std::size_t d = 0; d < kMaxDevices; ++d) {
    auto viewed = viewed_deformation(solver_, tick, d);
    const std::lock_guard lock(mutex_);
    shown_[d] = std::move(viewed);
  }
}

std::shared_ptr<const ViewedDeformation> TissueFrames::deformation(std::size_t device) const {
  const std::lock_guard lock(mutex_);
  return shown_[device];
}

}  // namespace palpate
