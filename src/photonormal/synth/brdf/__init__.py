"""Reflectance models. Each is called with cosines and returns f, radiance over irradiance, in 1/sr.

``f(cos_l, cos_v, cos_h, cos_d)``: n.l, n.v, n.h and l.h = v.h of a light l, the view v and the half vector h between
them. Isotropic, so these four determine it. Leading shapes broadcast; the result gains a channel axis before the last
axis: (..., 3, p) for cosines (..., p).
"""
