{{/* Go's own template functions and no others: so any renderer of Go templates can check the chart. */}}
{{- define "readygo.pod" -}}
automountServiceAccountToken: false
      securityContext:
        runAsNonRoot: true
        runAsUser: 10001
        runAsGroup: 10001
        fsGroup: 10001
        seccompProfile: {type: RuntimeDefault}
{{- end -}}
{{- define "readygo.container" -}}
startupProbe:
            httpGet: {path: /metrics, port: metrics}
            periodSeconds: 5
            failureThreshold: 60
          livenessProbe:
            httpGet: {path: /metrics, port: metrics}
            periodSeconds: 20
            timeoutSeconds: 10
            failureThreshold: 6
          securityContext:
            allowPrivilegeEscalation: false
            readOnlyRootFilesystem: true
            capabilities: {drop: [ALL]}
{{- end -}}
{{- define "readygo.volumes" -}}
- {name: cache, emptyDir: {}}
        - {name: tmp, emptyDir: {}}
{{- end -}}
{{- define "readygo.mounts" -}}
- {name: cache, mountPath: /cache}
            - {name: tmp, mountPath: /tmp}
            - {name: certs, mountPath: /certs, readOnly: true}
{{- end -}}
