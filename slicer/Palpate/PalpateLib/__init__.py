"""Logic of the module Palpate. Only `scene` uses Slicer's classes; the other files need NumPy alone."""
