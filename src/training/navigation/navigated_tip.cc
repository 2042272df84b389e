#include "palpate/navigation/navigated_tip.h"

namespace palpate {

std::optional<TipError> error_of_tip(const Navigation& navigation, const Point<Patient>& tip) {
  if (!navigation.patient.error) return {};
  const RigidError& registration = *navigation.patient.error;
  const ErrorSpread here = error_at(registration, tip), middle = error_at(registration, registration.about);
  const double own_mm2 = navigation.tip.error_mm * navigation.tip.error_mm +
                         navigation.tip.scatter_mm * navigation.tip.scatter_mm;
  const ErrorSpread all = spread_of(here.covariance_mm2 + own_mm2 / 3 * Eigen::Matrix3d::Identity());
  return TipError{all.rms_mm, all.max_mm, here.rms_mm > 2 * middle.rms_mm};
}

}  // namespace palpate
