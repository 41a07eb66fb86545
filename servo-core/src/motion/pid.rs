//! To come in this series: see DESIGN 4.3.
