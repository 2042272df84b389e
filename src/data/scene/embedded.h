#pragma once

#include "palpate/base/embedded_file.h"

namespace palpate {

/// The files of data/scenes/ and data/scripts/, compiled in.
const std::vector<EmbeddedFile>& embedded_scenes();
const std::vector<EmbeddedFile>& embedded_scripts();

}  // namespace palpate
