# SPDX-License-Identifier: Apache-2.0
"""Factors: residual and Jacobian in one kernel each.

Every factor inside an interval is differentiated with respect to the interval's local coordinates

    y = [eps_k, xi_dot(t_k), xi_ddot(t_k), xi, xi_dot, xi_ddot, b_k, b_{k+1}]   (48), b = [b_g, b_a],

and `local_to_knots` turns that into derivatives with respect to the two knots. Residuals follow the paper's
signs; Jacobians are d residual / d variable; whitening (division by sigma) is done by the factor.
"""
