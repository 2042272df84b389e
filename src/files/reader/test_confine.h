#pragma once

/// Queries about the confinement, for tests of modules that use it.
#include "reader/confine.h"
