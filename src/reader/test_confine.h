#pragma once

/// What is known of the confinement, for tests of rooms that read by it.
#include "reader/confine.h"
