#include <algorithm>

#include "palpate/palpation/virtual_run.h"
#include "palpate/verification/servo_timing.h"

namespace palpate {
namespace {

constexpr double kMaxPathSeconds = 600;

// script of the scene with a stroke on every structure before it is left; the object is stationary, so that
// the path is a list of points
Script stroking(const Script& script) {
  Script stroking = script;
  stroking.steps.clear();
  stroking.lines.clear();
  for (std::size_t s = 0; s < script.steps.size(); ++s) {
    const auto add = [&](const ScriptStep& step) {
      stroking.steps.push_back(step);
      stroking.lines.push_back(script.lines[s]);
    };
    const ScriptStep& step = script.steps[s];
    if (std::holds_alternative<RotateStep>(step) || std::holds_alternative<SlideStep>(step)) continue;
    if (std::holds_alternative<LeaveStep>(step)) add(SlideStep{});
    add(step);
  }
  return stroking;
}

// finds the longest run of ticks in contact
class LongestTouch {
 public:
  void observe(bool contact, std::size_t tick) {
    if (!contact)
      began_ = tick + 1;
    else if (tick + 1 - began_ > end_ - begin_) {
      begin_ = began_;
      end_ = tick + 1;
    }
  }
  std::size_t begin() const { return begin_; }
  std::size_t end() const { return end_; }

 private:
  std::size_t began_ = 0, begin_ = 0, end_ = 0;
};

}  // namespace

Result<PalpationPath> palpate_once(const LoadedScene& loaded, const Progress& progress) {
  auto setup = set_up_run(loaded, {}, {}, progress);
  if (!setup) return setup.error();
  setup->script = stroking(setup->script);
  const Model& model = *setup->model;
  progress.report("finding surfaces", 0);
  auto hand = ScriptedHand::create(model, setup->script);
  if (!hand) return hand.error();

  PalpationPath path{.rate_hz = setup->script.rate_hz,
                     .device = setup->device,
                     .hand = setup->hand,
                     .workspace = setup->workspace,
                     .parameters = setup->parameters,
                     .states = {},
                     .intended = {}};
  const auto max_ticks = static_cast<std::size_t>(kMaxPathSeconds * path.rate_hz);
  VirtualRun run(setup->model, *setup, std::move(*hand));
  LongestTouch touch;
  std::size_t touching = 0;
  while (path.states.size() < max_ticks) {
    if (progress.stopped()) return Progress::interrupted();
    const bool contact = (run.tick().device[0].flags & kFlagContact) != 0;
    if (!run.act()) break;
    touch.observe(contact, path.states.size());
    touching += contact;
    path.states.push_back(run.sensed());
    path.intended.push_back(run.intended());
  }

  if (touching == 0)
    return Error{ErrorKind::kBadInput, "the hand has not touched anything", model.title,
                 "choose a scene with a structure that is felt and can be reached"};
  path.in_contact = static_cast<double>(touching) / static_cast<double>(path.states.size());
  path.touch_begin = touch.begin();
  path.touch_end = touch.end();
  return path;
}

}  // namespace palpate
