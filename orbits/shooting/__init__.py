"""The equations of an orbit by shooting: their formulations, residuals and slopes, Newton's method, error bounds."""
