"""A result and a model for the examples of the docstrings."""

CART = """model Cart {
    coordinate x [m];
    input u [N];
    parameter m [kg], d [N*s/m], k [N/m];
    m*ddot(x) + d*dot(x) + k*x = u;
    pattern { amplitude lambda [m]; frequency w [rad/s]; x = point_to_point(0, lambda, w, 3); }
}
"""

RESULT = """{
  "schema": "tpm.identification/2",
  "model": "Cart",
  "parameters": [
    {"name": "m", "unit": "kg", "value": 2.0, "std": 0.01, "status": "identified"},
    {"name": "d", "unit": "N*s/m", "value": 3.0, "std": 0.02, "status": "identified"}
  ],
  "covariance": [[1e-4, 0.0], [0.0, 4e-4]],
  "rank": 2,
  "residual": 0.001
}
"""
