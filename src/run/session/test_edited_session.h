#pragma once

#include <cmath>

#include "palpate/device/model_change.h"
#include "palpate/server/viewer_host.h"

/// Sequence of edits that edited_session makes, so that a reader of its recording knows the expected content.
namespace palpate::testing {

/// Stiffness of the tissue from edit `number` on.
inline double edited_stiffness_N_per_mm(std::uint32_t number) {
  return 0.8 + 0.01 * (number % 40);
}
inline bool ask_for_stiffness(LiveHost& host, std::uint32_t number) {
  TissueRequest tissue;
  tissue.by = {number, true};
  tissue.changes[&ContactProperties::stiffness_N_per_mm] = edited_stiffness_N_per_mm(number);
  return host.set(tissue).ok();
}

/// Requests edit `number`, from 1, as the viewer of that number.
inline bool ask_for_edit(LiveHost& host, std::uint32_t number) {
  const ViewerIdentity by{number, true};
  SettingsRequest settings;
  settings.by = by;
  // re-arm after a stop as soon as the tip is free
  if (const auto stop = host.state().stop) (void)host.rearm({*stop, by});
  switch (number % 4) {
    case 0:
      return ask_for_stiffness(host, number);
    case 1:
      settings.max_force_N = 1 + 0.1 * (number % 7);
      settings.friction = number % 8 == 1;
      return host.set(settings).ok();
    case 2:
      settings.rotation_wxyz = {std::cos(0.001 * number), 0, 0, std::sin(0.001 * number)};
      return host.set(settings).ok();
    default:
      if (number % 8 == 3) {
        host.emergency_stop(by);
        return true;
      }
      settings.viscosity = number % 16 == 7;
      return host.set(settings).ok();
  }
}

/// Same for a milling session: a stroke, then an undo or a redo, if there is a stroke to undo or redo.
inline bool ask_for_stroke_edit(LiveHost& host, std::uint32_t number) {
  const ViewerIdentity by{number, true};
  SettingsRequest settings;
  settings.by = by;
  switch (number % 5) {
    case 1:
    case 3:
      settings.motor = number % 5 == 1;
      return host.set(settings).ok();
    case 4:
      (void)host.set(StrokeRequest{StrokeAction::kUndo, by, 0});
      return true;
    case 0:
      if (number % 10 == 0) (void)host.set(StrokeRequest{StrokeAction::kRedo, by, 0});
      return true;
    default:
      return ask_for_stiffness(host, number);
  }
}

}  // namespace palpate::testing
