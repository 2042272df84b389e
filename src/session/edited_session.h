#pragma once

#include <cmath>

#include "palpate/viewer_server.h"

/// What edited_session asks of its session, one edit after the other, so that who reads its recording knows
/// what has to be in it.
namespace palpate::testing {

/// Asks for the edit of that number, from 1, as the viewer of that number.
inline bool ask_for_edit(ViewerHost& host, std::uint32_t number) {
  const ViewerIdentity by{number, true};
  SettingsRequest settings;
  settings.by = by;
  // after a stop, as soon as the hand has left what it touched
  if (const auto stop = host.state().stop) (void)host.rearm({*stop, by});
  switch (number % 4) {
    case 0: {
      TissueRequest tissue;
      tissue.by = by;
      tissue.stiffness_N_per_mm = 0.8 + 0.01 * (number % 40);
      return host.set(tissue).ok();
    }
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

}  // namespace palpate::testing
