#pragma once

#include "palpate/recording/recording.h"
#include "palpate/server/viewer_server.h"

namespace palpate {

/// Originator of a viewer's request.
inline RequestedBy requested_by(const ViewerIdentity& viewer) {
  return {viewer.control ? Asker::kControlViewer : Asker::kViewingViewer, viewer.number};
}
/// Originator of a viewer's request to which an operator at this machine has consented.
inline RequestedBy agreed_to(const ViewerIdentity& viewer) {
  return {Asker::kAgreedViewer, viewer.number};
}

}  // namespace palpate
