"""The laws' equations as TeX, by policy: the site sets them as outlines, by matplotlib."""

from collections.abc import Mapping

LOOKAHEAD = (
    r"e_d = x, \quad e_h = \operatorname{atan2}(y, x), \quad e_o = \operatorname{wrap}(\theta_{ref} - \theta),"
    r" \quad m = e^{-\sqrt{x^2 + y^2} / d_m}",
    r"v = k_{lin} \, e_d, \qquad \omega = k_{ang} (1 - m) \, e_h + k_{ori} \, m \, e_o",
)
SMOOTH = (
    r"\kappa = -\frac{1}{r} \left( k_2 \left( \delta - \arctan(-k_1 \varphi) \right)"
    r" + \left( 1 + \frac{k_1}{1 + (k_1 \varphi)^2} \right) \sin \delta \right)",
    r"v = \min\left( \frac{v_0}{1 + \beta |\kappa|^{\lambda}}, \sqrt{2 a s} \right), \qquad \omega = v \, \kappa",
)
FIELD = (
    r"F_{att} = k_{att} \, (x^* - x), \qquad"
    r" F_{rep} = \sum_{d \leq \tau} k_{rep} \, \frac{x - x_o}{d^4}, \qquad v = F_{att} + F_{rep}",
    r"\ell_c = \frac{|F_{att}|}{|F_{rep}| + 10^{-4}} \leq \tau_{\ell} : \text{ a local minimum}",
)
HALF_PLANES = r"\min_v \, |v - u| \quad \text{subject to} \quad n_j \cdot v \geq b_j, \quad |v| \leq v_{max}"

EQUATIONS: Mapping[str, tuple[str, ...]] = {
    "lookahead_documented": LOOKAHEAD,
    "lookahead_retuned": LOOKAHEAD,
    "pure_pursuit": (
        r"\kappa = \frac{2 y}{d^2}, \qquad v = \min\left( v_0, \sqrt{2 a s} \right), \qquad \omega = v \, \kappa",
    ),
    "regulated_pure_pursuit": (
        r"\kappa = \frac{2 y}{x^2 + y^2}, \qquad"
        r" v_c(D) = \max\left( v_0 \min\left( 1, \frac{1}{r_{min} \, c(D)} \right), v_{min} \right)",
        r"v_{max} = \min_{D} \sqrt{v_c(D)^2 + 2 a \max(D - T v, 0)}, \qquad \omega \approx \kappa \, v",
    ),
    "polar": (r"v = k_{\rho} \, \rho, \qquad \omega = k_{\alpha} \, \alpha + k_{\beta} \, \beta",),
    "smooth_pose": SMOOTH,
    "smooth_pose_backward": SMOOTH,
    "stanley": (
        r"\delta = \operatorname{wrap}(\psi - \theta) - \arctan \frac{k \, e}{k_s + u_m}",
        r"v = u \cos \delta, \qquad \omega = \frac{u \sin \delta}{d}, \qquad"
        r" u = \min\left( v_0, \frac{d \sqrt{2 \alpha |\delta|}}{|\sin \delta|} \right)",
    ),
    "lqr": (
        r"\dot e = v \sin \theta_e, \qquad \dot \theta_e = \omega - \omega_{ref}, \qquad"
        r" \omega_{ref} = \frac{v \, \kappa \cos \theta_e}{1 - \kappa \, e}",
        r"\omega = \omega_{ref} - k_2 \left( \operatorname{clip}\left( \frac{k_1 e}{k_2} \right) + \theta_e \right)"
        r" - k_3 \left( \omega_m - \omega_{ref} \right)",
    ),
    "mpc": (
        r"\min \sum_k h \left( q_p |p_k - P(\sigma_k)|^2 + q_h (\theta_k - P_{\theta}(\sigma_k))^2"
        r" + r_a a_k^2 + r_{\alpha} \alpha_k^2 \right) - (1 - \eta)(\sigma_N - \sigma_0)"
        r" - \frac{2 \eta}{N + 1} \sum_k (\sigma_k - \sigma_0)",
    ),
    "mpc_pose": (
        r"\min \sum_k h \left( q_x x_k^4 + q_y y_k^2 + q_{\theta} \theta_k^4"
        r" + r \left( v_k^4 + \frac{\omega_k^4}{16} \right) \right)",
    ),
    "reeds_shepp": (
        r"v = d \min\left( v_0, \frac{\omega_{max}}{|\kappa|}, \sqrt{2 a s} \right), \qquad"
        r" \omega = v \, \kappa - |v| \left( \frac{2 \theta}{L} + \frac{d \, e}{L^2} \right)",
    ),
    "kanayama": (
        r"v = v_r \cos \theta_e + k_x x_e, \qquad"
        r" \omega = \omega_r + v_r \left( k_y y_e + k_{\theta} \sin \theta_e \right)",
    ),
    "samson": (
        r"k = 2 \zeta \sqrt{\omega_r^2 + b v_r^2}, \qquad v = v_r \cos \theta_e + k x_e, \qquad"
        r" \omega = \omega_r + b v_r \frac{\sin \theta_e}{\theta_e} y_e + k \theta_e",
    ),
    "offset_point": (r"u = \dot p_{r,b} + k (p_{r,b} - p_b), \qquad v = u_x, \qquad \omega = \frac{u_y}{b}",),
    "feedback_linear": (
        r"u = \ddot p_r + 2 \zeta a (\dot p_r - \dot p) + a^2 (p_r - p), \qquad"
        r" v = \xi, \qquad \omega = \frac{u_y}{\xi}, \qquad \dot \xi = u_x",
    ),
    "tv_lqr": (
        r"u_k = c_k - K_k z_k, \qquad c_k = \frac{v_{k+1} - d v_k}{1 - d}, \qquad"
        r" K_k = (R + B_k^T P_{k+1} B_k)^{-1} B_k^T P_{k+1} A_k",
    ),
    "pid_omni": (r"u = \dot r + k_p e + k_i \int e \, dt, \qquad \omega = \omega_r + k_{\theta} \theta_e",),
    "apf_documented": FIELD,
    "apf_escape": FIELD,
    "apf_corrected": (
        r"F_{att} = k \, e, \qquad F_{rep} = \eta \left( \frac{1}{\rho} - \frac{1}{\rho_0} \right)"
        r" \frac{d^2}{\rho^2} \, n + \eta \left( \frac{1}{\rho} - \frac{1}{\rho_0} \right)^2 e"
        r" \quad (\rho \leq \rho_0)",
    ),
    "vfh_plus": (
        r"h_k = \max_{d < w} \left( 1 - \frac{d^2}{w^2} \right), \qquad"
        r" c^* = \arg \min_c \; \mu_1 |c - c_{goal}| + \mu_2 |c - c_{now}| + \mu_3 |c - c_{last}|",
    ),
    "dwa": (
        r"v \leq \sqrt{2 \operatorname{dist}(v, \omega) \, a}, \qquad"
        r" |\omega| \leq \sqrt{2 \operatorname{angle}(v, \omega) \, a_{\omega}}",
        r"G(v, \omega) = \alpha \left( 1 - \frac{|\theta_{left}|}{\pi} \right) + \beta \frac{t}{T}"
        r" + \gamma \frac{v}{v_{max}} + \delta \frac{d_0 - d_T}{v_{max} T} + \epsilon \frac{g}{g_0}",
    ),
    "mppi": (
        r"w_k = \frac{e^{-(S_k - \min S) / \lambda}}{\sum_j e^{-(S_j - \min S) / \lambda}}, \qquad"
        r" m \leftarrow \sum_k w_k \, u_k",
    ),
    "orca": (r"VO = \{ v : |p - (v - v_o) t| < R, \; 0 < t \leq T \}", HALF_PLANES),
    "orca_team": (HALF_PLANES, r"v = u_x, \qquad \omega = \frac{u_y}{L}"),
    "central": (
        r"u = s \dot p(t) + k (p(t) - x), \qquad \dot t = s, \qquad s = \min( \max(0, 1 - e / \ell), s_{bend})",
    ),
    "nav2_dwb": (r"J = w_o c + \frac{\Delta}{2} \left( w_p n_p + w_g n_g + w_p' n_p' + w_g' n_g' \right) + w_r r",),
    "nav2_mppi": (
        r"w_k = \frac{e^{-(S_k - \min S) / \lambda}}{\sum_j e^{-(S_j - \min S) / \lambda}}, \qquad"
        r" m \leftarrow \sum_k w_k \, u_k",
    ),
    "ppo": (
        r"\max_{\theta} \; \hat E_t \left[ \min\left( r_t(\theta) \hat A_t,"
        r" \operatorname{clip}(r_t(\theta), 1 - \epsilon, 1 + \epsilon) \hat A_t \right) \right], \qquad"
        r" r_t(\theta) = \frac{\pi_{\theta}(a_t | s_t)}{\pi_{old}(a_t | s_t)}",
    ),
}
