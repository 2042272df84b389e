#pragma once

#include "palpate/recording/recording.h"
#include "palpate/server/viewer_host.h"

namespace palpate {

/// Originator of a viewer's request.
inline RequestedBy requested_by(const ViewerIdentity& viewer) {
  return {viewer.control ? Originator::kControlViewer : Originator::kViewingViewer, viewer.number};
}
/// Originator of a viewer's request to which an operator at this machine has consented.
inline RequestedBy with_consent_of(const ViewerIdentity& viewer) {
  return {Originator::kViewerWithConsent, viewer.number};
}

}  // namespace palpate
