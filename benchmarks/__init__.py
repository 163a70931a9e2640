"""Programs that measure: times, memory, and studies behind the figures in docs/. No part of the package."""
